"""One process per lab: turns camera frames into poses, and keeps the table and the state of the fleet."""
