"""Data made by the program itself: shapes, a range scanner in software, and pairs of what it sees."""
