"""Generated data: shapes, a simulated range scanner, and pairs of scans."""
