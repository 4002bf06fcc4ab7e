"""The wheels and their dead-man."""
