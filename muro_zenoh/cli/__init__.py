"""The command `muro`: a thin face over all the rest."""
