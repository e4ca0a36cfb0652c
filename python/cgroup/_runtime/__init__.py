"""Tools for computations: memory, progress, worker threads, interrupts, plug-ins, SQLite files."""
