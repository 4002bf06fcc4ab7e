"""The figures of the three reports, drawn anew from our own laws, and those that show what is better than there.

Every figure is a function from an :class:`~muro_zenoh.figures.catalogue.Effort` to a matplotlib figure; the same seed
gives the same picture. matplotlib is the extra ``figures`` and is imported when a figure is drawn.
"""
