"""Pictures of runs, the interactive report, and the comparison with a reference attitude."""
