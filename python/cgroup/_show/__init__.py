"""Display of results: figures and notebook tables."""
