"""Clock, process lifetime and logs."""
