"""The report: one HTML file, its tables, figures and style."""
