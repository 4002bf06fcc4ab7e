"""The only place where pixels become metres."""
