"""Voronoi cells against SciPy and shapely, centroids and costs against integrals, Lloyd's descent."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st

from muro_zenoh.geometry import Bounds
from muro_zenoh.planning.coverage import (
    Peaks,
    Point,
    Polygon,
    area,
    cell,
    cell_cost,
    cells,
    centroid,
    coverage_cost,
    lloyd_goal,
    lloyd_step,
    same_place,
)

ARENA = Bounds(-2.1, 2.1, -1.5, 1.5)
WHOLE = 4.2 * 3.0
PEAKS = Peaks(((0.8, 0.3, 0.5, 1.0), (-1.0, -0.5, 0.4, 2.0)))
SITE = st.tuples(st.floats(-2.1, 2.1), st.floats(-1.5, 1.5))


def random_sites(count: int, seed: int) -> list[Point]:
    return [(x, y) for x, y in np.random.default_rng(seed).uniform([-2.1, -1.5], [2.1, 1.5], (count, 2)).tolist()]


def on_the_border(seed: int) -> list[Point]:
    corners = [(-2.1, -1.5), (2.1, -1.5), (2.1, 1.5), (-2.1, 1.5)]
    return [*random_sites(6, seed), *corners, (0.0, 1.5), (2.1, 0.2)]


def scipy_areas(sites: list[Point]) -> list[float]:
    """Cells by SciPy: the sites mirrored at the four walls make the walls bisectors."""
    spatial = pytest.importorskip("scipy.spatial")
    points = np.array(sites)
    mirrored = [points]
    for axis, wall in ((0, -2.1), (0, 2.1), (1, -1.5), (1, 1.5)):
        image = points.copy()
        image[:, axis] = 2.0 * wall - image[:, axis]
        mirrored.append(image)
    diagram = spatial.Voronoi(np.concatenate(mirrored))
    return [
        spatial.ConvexHull(diagram.vertices[diagram.regions[diagram.point_region[k]]]).volume for k in range(len(sites))
    ]


@pytest.mark.parametrize("count", [3, 4, 10, 40, 100])
@pytest.mark.parametrize("seed", [1, 2])
def test_areas_agree_with_scipy(count: int, seed: int) -> None:
    sites = random_sites(count, seed)
    wanted = scipy_areas(sites)
    assert [area(p) for p in cells(sites, ARENA)] == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_border_sites_agree_with_shapely_alone(seed: int) -> None:
    sites = on_the_border(seed)
    box = shapely.box(-2.1, -1.5, 2.1, 1.5)
    alone = shapely.voronoi_polygons(shapely.MultiPoint(sites), extend_to=box, ordered=True)
    wanted = [shapely.intersection(piece, box).area for piece in alone.geoms]
    assert [area(p) for p in cells(sites, ARENA)] == pytest.approx(wanted, abs=1e-9)
    assert sum(wanted) == pytest.approx(WHOLE)


def test_duplicates_have_the_same_cell() -> None:
    sites = random_sites(7, 3)
    twice = [sites[0], *sites, sites[3], (sites[3][0] + 1e-10, sites[3][1])]
    alone = dict(zip(sites, cells(sites, ARENA), strict=True))
    for site, polygon in zip([sites[0], *sites, sites[3], sites[3]], cells(twice, ARENA), strict=True):
        assert area(polygon) == pytest.approx(area(alone[site]), abs=1e-9)
    assert same_place(twice) == [0, 0, 2, 3, 4, 5, 6, 7, 4, 4]


@pytest.mark.parametrize("places", [1, 2])
def test_one_or_two_places_work_too(places: int) -> None:
    sites = [(0.5, 0.2), (-0.5, 0.2)][:places] * 3
    assert [area(p) for p in cells(sites, ARENA)][:places] == pytest.approx([WHOLE / places] * places)


def test_sites_in_a_line_work_too() -> None:
    sites = [(x, 0.0) for x in (-1.5, -0.5, 0.5, 1.5)]
    assert [area(p) for p in cells(sites, ARENA)] == pytest.approx([1.1 * 3, 3.0, 3.0, 1.1 * 3])


@given(sites=st.lists(SITE, min_size=1, max_size=12), probe=SITE)
def test_cells_are_what_is_nearest(sites: list[Point], probe: Point) -> None:
    distances = [math.dist(probe, site) for site in sites]
    nearest, *others = sorted(range(len(sites)), key=distances.__getitem__)
    # On a border between cells, rounding decides.
    assume(not others or distances[others[0]] - distances[nearest] > 1e-6)
    point = shapely.Point(probe)
    for k, polygon in enumerate(cells(sites, ARENA)):
        if k == nearest:
            assert shapely.Polygon(polygon).distance(point) < 1e-9
        elif polygon:
            assert shapely.Polygon(polygon).distance(point) > 0.0


@given(sites=st.lists(SITE, min_size=1, max_size=12, unique=True))
def test_cells_partition_the_arena_and_are_counter_clockwise(sites: list[Point]) -> None:
    assume(len(set(same_place(sites))) == len(sites))
    polygons = cells(sites, ARENA)
    assert sum(map(area, polygons)) == pytest.approx(WHOLE)
    assert all(area(p) >= 0.0 for p in polygons)


def test_a_site_outside_may_have_no_cell_and_is_sent_inside() -> None:
    sites = [(3.0, 0.0), (2.0, 0.0), (-1.0, 0.0)]
    assert cell(0, sites, ARENA) == ()
    assert lloyd_goal(0, sites, ARENA) == (2.1, 0.0)
    with pytest.raises(ValueError, match="without area"):
        centroid(())


def grid_integrals(polygon: Polygon, site: Point) -> tuple[float, float, float]:
    """Centroid and cost by brute force on a fine grid."""
    x_min, y_min, x_max, y_max = shapely.Polygon(polygon).bounds
    n = 700
    x, y = np.meshgrid(
        x_min + (np.arange(n) + 0.5) / n * (x_max - x_min), y_min + (np.arange(n) + 0.5) / n * (y_max - y_min)
    )
    shape = shapely.Polygon(polygon)
    shapely.prepare(shape)
    weight = PEAKS(x, y) * shapely.contains_xy(shape, x, y) * (x_max - x_min) * (y_max - y_min) / n**2
    mass = weight.sum()
    return (
        (weight * x).sum() / mass,
        (weight * y).sum() / mass,
        (weight * ((x - site[0]) ** 2 + (y - site[1]) ** 2)).sum(),
    )


def test_weighted_centroids_and_costs_are_their_integrals() -> None:
    sites = random_sites(5, 4)
    for site, polygon in zip(sites, cells(sites, ARENA), strict=True):
        cx, cy, cost = grid_integrals(polygon, site)
        assert centroid(polygon, PEAKS) == pytest.approx((cx, cy), abs=2e-3)
        assert cell_cost(site, polygon, PEAKS) == pytest.approx(cost, rel=5e-3)


def test_without_density_centroids_are_exact() -> None:
    for polygon in cells(random_sites(12, 5), ARENA):
        middle = shapely.Polygon(polygon).centroid
        assert centroid(polygon) == pytest.approx((middle.x, middle.y), abs=1e-12)
        flat = centroid(polygon, lambda x, y: np.full_like(x, 3.0))
        assert flat == pytest.approx((middle.x, middle.y), abs=1e-12)
    square = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
    assert cell_cost((0.5, 0.5), square) == pytest.approx(1.0 / 6.0)


@pytest.mark.parametrize("density", [None, PEAKS], ids=["flat", "peaks"])
@pytest.mark.parametrize("seed", range(4))
def test_lloyd_never_raises_the_cost_and_comes_to_rest(density: Peaks | None, seed: int) -> None:
    sites: tuple[Point, ...] = tuple(random_sites(8, seed))
    costs = [coverage_cost(sites, ARENA, density)]
    for _ in range(150):
        sites = lloyd_step(sites, ARENA, density)
        costs.append(coverage_cost(sites, ARENA, density))
    assert all(after <= before + 1e-6 for before, after in itertools.pairwise(costs))
    assert costs[-1] < 0.9 * costs[0]
    step = max(math.dist(a, b) for a, b in zip(sites, lloyd_step(sites, ARENA, density), strict=True))
    assert step < 0.01


def test_robots_at_one_place_separate() -> None:
    sites: tuple[Point, ...] = ((0.3, 0.3),) * 4
    for _ in range(60):
        sites = lloyd_step(sites, ARENA)
    assert min(math.dist(a, b) for k, a in enumerate(sites) for b in sites[:k]) > 1.0


def test_invalid_peaks_are_refused() -> None:
    with pytest.raises(ValueError, match="floor"):
        Peaks((), floor=0.0)
    with pytest.raises(ValueError, match="width above 0"):
        Peaks(((0.0, 0.0, 0.0, 1.0),))
