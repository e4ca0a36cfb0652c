"""The paper's evaluation: configured, planned, run, kept in records, and reported."""
