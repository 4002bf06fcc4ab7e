"""The only place where pixels are converted to metres."""
