"""Orders to a running fleet, and the robots' answers to them, as values: for command line, page and scripts alike."""
