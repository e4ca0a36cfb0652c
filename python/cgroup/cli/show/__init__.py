"""Show results: tables, text, JSON, pages and pictures."""
