"""Running computations: memory, progress, worker threads, interrupts, plug-ins, files of SQLite."""
