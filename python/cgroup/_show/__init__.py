"""Showing results: figures and notebook tables."""
