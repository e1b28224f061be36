"""What the signal of one sensor shows by itself: the end of its range, and silence."""
