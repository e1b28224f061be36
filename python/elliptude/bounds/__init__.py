"""What is known of errors, as bounds of measured angles and turns. NumPy alone."""
