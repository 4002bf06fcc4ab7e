"""All Voronoi cells of many robots at once, by shapely; for the base station and for figures.

Apart from :mod:`muro_zenoh.planning.coverage`, because importing shapely costs an agent 0.1 s and it needs only its own
cell.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from muro_zenoh.planning.arena import Bounds
from muro_zenoh.planning.coverage import Point, Polygon, cell, same_place


def voronoi_cells(sites: Sequence[Point], bounds: Bounds) -> tuple[Polygon, ...]:
    """The Voronoi cells of all sites within the arena, in their order.

    Sites at the same place have the same cell (shapely alone raises). A site outside the arena may have an empty one.

    Args:
        sites: all sites [m, world].
        bounds: the arena.
    """
    first = same_place(sites)
    unique = sorted(set(first))
    # Fewer than three have no Voronoi diagram in GEOS.
    if len(unique) < 3:
        return tuple(cell(k, sites, bounds) for k in range(len(sites)))
    arena = shapely.box(bounds.x_min, bounds.y_min, bounds.x_max, bounds.y_max)
    whole = shapely.voronoi_polygons(shapely.MultiPoint([sites[k] for k in unique]), extend_to=arena, ordered=True)
    clipped = shapely.intersection(np.array(whole.geoms), arena)
    polygons = {k: _corners(piece) for k, piece in zip(unique, clipped, strict=True)}
    return tuple(polygons[k] for k in first)


def _corners(piece: shapely.Geometry) -> Polygon:
    if not isinstance(piece, shapely.Polygon) or piece.is_empty:
        return ()
    ring = shapely.get_coordinates(shapely.get_exterior_ring(shapely.normalize(piece)))[:-1]
    # shapely's normal form is clockwise
    return tuple((x, y) for x, y in ring[::-1].tolist())
