"""Results shown: figures and tables of notebooks."""
