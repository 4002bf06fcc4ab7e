"""What a run was worth: what is collected of it, and its score sheet."""
