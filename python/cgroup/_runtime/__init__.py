"""How computations run: memory, progress, side by side, interrupted, plugged in."""
