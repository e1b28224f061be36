"""Whether sensors agree with one another, subject by subject."""
