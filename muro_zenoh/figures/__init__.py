"""The figures of the three reports, redrawn with our own laws, and figures of the improvements over them.

Every figure is a function from an :class:`~muro_zenoh.figures.catalogue.Effort` to a matplotlib figure; the same seed
gives the same picture. matplotlib is in the extra ``figures`` and is imported when a figure is drawn.
"""
