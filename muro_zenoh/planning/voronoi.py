"""All Voronoi cells of many robots at once, by shapely; for the base station and for figures.

Apart from :mod:`muro_zenoh.planning.coverage`, because importing shapely costs an agent 0.1 s and it needs only its own
cell.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from muro_zenoh.geometry import Bounds
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
    pieces = np.array(whole.geoms)
    # Only the outer cells need cutting, which takes longer than the diagram.
    x_min, y_min, x_max, y_max = shapely.bounds(pieces).T
    outer = (x_min < bounds.x_min) | (y_min < bounds.y_min) | (x_max > bounds.x_max) | (y_max > bounds.y_max)
    pieces[outer] = shapely.intersection(pieces[outer], arena)
    polygons = dict(zip(unique, _corners(pieces), strict=True))
    return tuple(polygons[k] for k in first)


def _corners(pieces: NDArray[np.object_]) -> list[Polygon]:
    """Corners counter-clockwise; none for a cell outside the arena, of which a point or an edge may be left."""
    pieces[shapely.get_dimensions(pieces) < 2] = None
    rings = shapely.get_exterior_ring(pieces)
    places, index = shapely.get_coordinates(rings, return_index=True)
    counts = np.bincount(index, minlength=len(pieces)).tolist()
    clockwise = (~shapely.is_ccw(rings)).tolist()
    polygons, start = [], 0
    rows = [(x, y) for x, y in places.tolist()]
    for count, reverse in zip(counts, clockwise, strict=True):
        corners = rows[start : start + count - 1] if count else []
        polygons.append(tuple(reversed(corners) if reverse else corners))
        start += count
    return polygons
