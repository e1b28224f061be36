"""Single questions to each row's update: the answers of a guaranteed run, and whether the truth is in them."""
