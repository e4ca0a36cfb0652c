"""Why each match was kept or dropped: by which rule of the method, and how it stands to the others."""

from cgroup._explain.matches import explain_match, explain_matches

__all__ = ["explain_match", "explain_matches"]
