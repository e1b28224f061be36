"""What is found of a log and of what is stated of it: what may be wrong, and what would be stated instead."""
