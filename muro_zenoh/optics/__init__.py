"""Calibrated cameras: from places to pixels.

The way back, from pixels to places, is in ``basestation.localization`` and nowhere else.
"""
