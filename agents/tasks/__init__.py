"""What an agent does: localize, drive, and the behaviours."""
