"""What is collected of a run, and the score sheet that comes of it."""
