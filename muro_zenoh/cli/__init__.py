"""The command `muro`: arguments in, text out."""
