"""Where the body's axes may point, on the sphere of directions."""
