"""How results are shown: as tables, text, JSON, pages and pictures."""
