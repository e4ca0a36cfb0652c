"""Run the command line as ``python -m cgroup``."""

from cgroup.cli import main

if __name__ == "__main__":
    main()
