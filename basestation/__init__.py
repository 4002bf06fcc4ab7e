"""One process per lab: camera frames become poses, and the fleet is kept account of."""
