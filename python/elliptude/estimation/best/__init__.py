"""The best estimate beside the sets: by a filter without guarantee, and how far it may be off by the guaranteed run."""
