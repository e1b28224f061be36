"""What a frame that a gyro carries along does to means over windows, as far as it is off."""
