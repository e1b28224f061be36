"""The picture of an estimation, and what the sensors measured, which the page shows, too."""
