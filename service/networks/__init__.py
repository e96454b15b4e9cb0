"""Networks: imported, listed, drawn."""
