"""CSV files: how they are written, what recorders make of them, and folders of them."""
