"""cgroup beside the libraries that users would pick instead, on the same cases; see the README here."""
