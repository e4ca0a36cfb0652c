"""What the figures, tables and the chooser of the methods' pages are made by."""
