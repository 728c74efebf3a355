"""Sea surface of tiles and frames by morphological opening."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Gt
from numpy.typing import NDArray

from seaclutter_cli.airborne.ditches import BANK_M, DITCH_HEIGHT_M
from seaclutter_cli.airborne.echo_reader import EchoReader
from seaclutter_cli.airborne.following import CellDetails, FollowedSurface, follow_waves
from seaclutter_cli.airborne.islands import commonest_level, island_cells
from seaclutter_cli.airborne.land import Shores, shores_of
from seaclutter_cli.airborne.looks import Look, OpenedLooks, WithoutLand
from seaclutter_cli.airborne.quarters import LocalWaves, local_waves
from seaclutter_cli.airborne.rising import height_limits
from seaclutter_cli.airborne.squares import squares_of
from seaclutter_cli.airborne.standing import standing_objects
from seaclutter_cli.airborne.waves import Waves, estimate_waves, local_levels, other_levels
from seaclutter_cli.grids.elevation import ElevationGrid
from seaclutter_cli.grids.opening import SurfaceParams

Cells = NDArray[np.float64]
Mask = NDArray[np.bool_]

CALM_M = 0.5
"""Greatest height above the opened surface that separates objects from calm water."""
ROUGH_M = 0.4
"""Height of crests from which the surface follows the waves: groups of waves are higher than others."""
_CREST_DEVIATIONS = 3.0
_CALM_DEVIATIONS, _CALMEST_M = 6.0, 0.35
_PIT = 2.0
_LAND_DEVIATIONS, _ISLAND_DEVIATIONS = 4.0, 6.0


@dataclass(frozen=True, kw_only=True)
class SeparationParams(SurfaceParams):
    """Parameters of the separation of a tile into sea and non-sea points.

    Parameters
    ----------
    height_m : float or "auto"
        A point higher than this above the opened surface is a non-sea point, as in [Shi2022]; auto: a height from the
        waves, 0.35 to 0.5 m on calm water, and a surface that follows them on rough water.
    island_m : float or None
        The opened surface is land where it rises more than this above the sea level, down to ``height_m`` above that
        level; null: it is sea, as in [Shi2022].
    land : {"keep", "class2", "ignore"}
        What low and flat land becomes: non-sea points; the same, with class 2 on the ground; or sea, as in [Shi2022].
    trust_classes : tuple of {2, 9}
        ASPRS classes of the input that are right: its ground (2), its water (9), or both. Points of these classes keep
        them, and tell land and water around them.
    """

    height_m: Annotated[float, Gt(0)] | Literal["auto"] = "auto"  # type: ignore[assignment]  # a frame is too small
    island_m: Annotated[float, Gt(0)] | None = 2.0
    land: Literal["keep", "class2", "ignore"] = "keep"
    trust_classes: tuple[Literal[2, 9], ...] = ()

    @property
    def follows_waves(self) -> bool:
        """Whether the surface and the height follow the waves."""
        return self.height_m == "auto"

    @property
    def threshold_m(self) -> float:
        """Greatest height above the opened surface that separates objects from calm water."""
        return CALM_M if self.height_m == "auto" else self.height_m

    def __post_init__(self) -> None:
        """Check that ``island_m`` is at least ``height_m``."""
        super().__post_init__()
        if self.island_m is not None and self.island_m < self.threshold_m:
            raise ValueError(f"island_m ({self.island_m:g}) must not be less than height_m ({self.threshold_m:g})")


@dataclass(frozen=True)
class RoughWater:
    """What the surface of one strip needs to know about the tile, and about the strip's cells.

    Parameters
    ----------
    waves : Waves
        Waves of the tile.
    land : mapping of (int, int) to ndarray, shape (256, 256), bool, or None
        Land of the tile by block.
    levels : mapping of (int, int) to ndarray, shape (256, 256), float64, or None
        Level of the nearest body of water by block; None if none is known.
    details : CellDetails
        Highest elevations, intensities and numbers of echoes of the strip.
    standing : mapping of (int, int) to ndarray, shape (256, 256), float64
        Elevations that strips show alike by block (`standing_elevations`); empty if no others overlap.
    ditches : mapping of (int, int) to ndarray, shape (256, 256), float64
        Levels of ditches in that land by block; NaN elsewhere.
    """

    waves: Waves
    land: Mapping[tuple[int, int], Mask] | None
    levels: Mapping[tuple[int, int], Cells] | None
    details: CellDetails
    standing: Mapping[tuple[int, int], Cells] = field(default_factory=dict)
    ditches: Mapping[tuple[int, int], Cells] = field(default_factory=dict)


def _on_grid(grid: ElevationGrid, by_block: Mapping[tuple[int, int], NDArray[Any]], missing: float) -> NDArray[Any]:
    """Return cells by block on a grid of some of the blocks, shape (S, 256, 256)."""
    cells = np.full(grid.lowest.shape, missing)
    for block in grid.blocks.keys() & by_block.keys():
        cells[grid.blocks[block]] = by_block[block]
    return cells


def _views(whole: Look, looks: Iterable[Look]) -> tuple[Iterable[Look], LocalWaves]:
    """Return the whole tile or, if it mixes several moments, its looks if they show a sea; and the waves of either."""
    together = local_waves([whole])
    if together.is_mixed:
        alone = local_waves(looks)
        if alone.is_one_sea:
            return looks, alone
    return [whole], together


class SeaSurfaceModel:
    r"""Sea surface of a tile or frame: the opening of its grid of lowest elevations ([Shi2022], section 1.1).

    Parameters
    ----------
    grid : ElevationGrid
        Grid of all valid points.
    params : SurfaceParams
        Window and heights. With `SeparationParams`, islands are handled, too.
    echoes : EchoReader, optional
        Reads the echoes of the tile; without it, only islands are land.
    rough : RoughWater, optional
        The surface follows these waves.
    looks : iterable of ElevationGrid, optional
        Grids of what each look of the tile shows, for waves that are not recognised where several meet; iterated over
        repeatedly.

    Attributes
    ----------
    waves : Waves or None
        Estimated waves; None if the height is fixed or less than half of the tile looks like sea.
    followed : FollowedSurface or None
        Surface of rough water; None where the opened surface is used.

    Notes
    -----
    A point is a non-sea point if it is more than :math:`T_{\max}` above the opened surface of its cell.

    * With ``height_m: auto``, `estimate_waves` finds whether crests reach more than 0.4 m above the opened
      surface. If so, the surface follows the waves (`follow_waves`). Otherwise, objects are six standard deviations
      above the median of the water, at least 0.35 and at most 0.5 m above the opened surface. Where most rough parts do
      not oscillate, cells may show several moments; waves are then those of single looks.
    * Waves and swell: the opened surface follows waves longer than about twice the window. For shorter waves, the
      threshold has to exceed the height of their crests. A window much wider than the objects cuts off the crests of
      swell.
    * Edges of a tile: windows are inside the bounding rectangle of all points. An object cut by the edge is separated
      by the part inside, as if there were nothing beyond.
    * Echoes from below the surface are ignored in tiles: single cells deeper than twice ``height_m``.
    * Empty cells are filled by `filled` from up to a window's width away; cells that remain empty are ignored.
    * An object wider than the window leaves its inner part in the opened surface, as if it were sea. ``island_m`` finds
      that part by its elevation. A candidate cell has its lowest point or opened surface more than ``height_m`` above
      the sea level. Candidates joined by side or corner are land if the opened surface of one of them is more than
      ``height_m``, and its lowest point or opened surface more than ``island_m``, above the sea level. Heights over
      land are relative to the sea level: the median of the opened surface in its most frequent elevation step of
      ``island_m`` / 4, since land has many elevations and the sea few.

    References
    ----------
    .. [1] Shi Liang, Xing Junxin, Cai Yanjing (2022). "Classification of ship LIDAR point cloud data based on machine
       learning algorithm". Ship Science and Technology 44(17), 140-143. doi:10.3404/j.issn.1672-7649.2022.17.028
    """

    def __init__(
        self,
        grid: ElevationGrid,
        params: SurfaceParams,
        echoes: EchoReader | None = None,
        rough: "RoughWater | None" = None,
        looks: Iterable[ElevationGrid] = (),
    ) -> None:
        self._grid = grid
        self.params = params
        tile = isinstance(params, SeparationParams)
        pit_m = _PIT * params.threshold_m if tile else None
        whole = Look.of(grid, params.window_m, pit_m)
        lowest, self._opened = whole.lowest, whole.opened
        self._height_m = params.threshold_m
        self._has_crests = False
        self.waves: Waves | None = None
        self.followed: FollowedSurface | None = None
        self.shores: Shores | None = None
        self._land = self._islands = self._ditches = np.zeros(lowest.shape, np.bool_)
        if not isinstance(params, SeparationParams):
            return
        top = self._opened + params.threshold_m
        if params.land == "class2":
            self._ground_top = top
        if rough is not None:
            self._follow(whole, rough)
            return
        if params.follows_waves or params.land != "ignore":
            self._find_water(whole, OpenedLooks(looks, params.window_m, pit_m), echoes, top, params)
        if len(self._opened):
            self._level_land(params)

    def _find_water(
        self, whole: Look, looks: Iterable[Look], echoes: EchoReader | None, top: Cells, params: SeparationParams
    ) -> None:
        """Set the shores and waves of a tile, from echoes up to an elevation of each cell."""
        views, local = _views(whole, looks)
        if params.land != "ignore" and echoes is not None:
            squares = squares_of(whole.grid, whole.lowest, whole.lowest <= top)
            self.shores = shores_of(whole, squares, echoes, top, local)
        if params.follows_waves:
            land = self.land_by_block
            self.waves = estimate_waves(views if land is None else WithoutLand(views, land))

    def _level_land(self, params: SeparationParams) -> None:
        """Lower the opened surface to the level of the water on islands and other land."""
        shores = self.shores
        if shores is not None and not shores.bodies:
            self._land = shores.land
        elif shores is not None and (shores.land.any() or shores.steps_m > params.threshold_m):
            island_m = params.island_m or np.inf
            grown = island_cells(self._grid, self._opened, shores.level_m, shores.bank_m, island_m, shores.land)
            self._land = grown | shores.land
            self._opened[self._land] = shores.level_m[self._land]
        elif params.island_m is not None:
            sea_level = commonest_level(self._grid, self._opened, params.island_m / 4)
            self._islands = island_cells(self._grid, self._opened, sea_level, params.threshold_m, params.island_m)
            self._opened[self._islands] = sea_level
        if shores is not None:
            self._fill_ditches(shores.ditch_m, self._opened)

    def _follow(self, whole: Look, rough: "RoughWater") -> None:
        """Set the surface of rough water; the crests of waves must not join islands, nor become some."""
        waves, params, lowest = rough.waves, self.params, whole.lowest
        self.waves = waves
        own = _on_grid(self._grid, rough.land or {}, False)
        levels, deviations = local_levels(whole, waves)
        if rough.levels is not None:
            levels = other_levels(_on_grid(self._grid, rough.levels, waves.level_m), waves)
        land = own.copy()
        if isinstance(params, SeparationParams) and params.island_m is not None:
            above = _LAND_DEVIATIONS * deviations
            high = np.maximum(params.island_m, _ISLAND_DEVIATIONS * deviations)
            land |= island_cells(self._grid, self._opened, levels, above, high, own)
        step = levels - waves.level_m
        standing = _on_grid(self._grid, rough.standing, -np.inf)
        stands = standing_objects(self._grid, lowest - levels, standing - levels, deviations) & ~land
        details = replace(rough.details, standing=stands)
        found = follow_waves(self._grid, lowest - step, land, waves, lowest - self._opened, details)
        self.followed = replace(found, surface=found.surface + step)
        self._limits = height_limits(self._grid, lowest, land, self.followed, details)
        self._land, self._islands = own, land
        self._fill_ditches(_on_grid(self._grid, rough.ditches, np.nan), self.followed.surface)

    def _fill_ditches(self, level_m: Cells, surface: Cells) -> None:
        """Set the water of ditches, which is no land, in the surface; levels are NaN elsewhere."""
        self._ditches = np.isfinite(level_m)
        surface[self._ditches] = level_m[self._ditches]
        self._land, self._islands = self._land & ~self._ditches, self._islands & ~self._ditches

    def height(self, xyz: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the height above the surface in metres, shape (N,), of points from the grid, shape (3, N)."""
        return self.heights(xyz[2], self._grid.locate(xyz[0], xyz[1]))[0]

    def heights(
        self, z: NDArray[np.float64], cell: NDArray[np.integer[Any]]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64] | float]:
        """Return the heights of points above the surface, and the height over which each is a non-sea point.

        Parameters
        ----------
        z : ndarray, shape (N,), float64
            Elevations in metres.
        cell : ndarray, shape (N,), integer
            Cell of each point in the grid, as `ElevationGrid.locate` returns it.
        """
        if self.followed is not None:
            height = z - self.followed.surface.reshape(-1)[cell]
            limit: NDArray[np.float64] | float = self._limits.limit.reshape(-1)[cell]
        else:
            height = np.asarray(z - self._opened.reshape(-1)[cell])
            limit = self._height_m
        if self._land.any():
            limit = np.where(self._land.reshape(-1)[cell], -np.inf, limit)
        if self._ditches.any():
            limit = np.where(self._ditches.reshape(-1)[cell], DITCH_HEIGHT_M, limit)
        return height, limit

    def is_ground(self, z: NDArray[np.float64], cell: NDArray[np.integer[Any]]) -> Mask:
        """Return whether points are on land or a bank, and no higher above the opened surface than calm water."""
        on_land, in_ditch = (cells.reshape(-1)[cell] for cells in (self._land, self._ditches))
        top = self._ground_top.reshape(-1)[cell] + BANK_M * in_ditch
        return np.asarray((on_land | in_ditch) & (z <= top))

    @property
    def is_rough(self) -> bool:
        """Whether crests may rise more than 0.4 m above the opened surface."""
        return self.waves is not None and (self.waves.highest_m > ROUGH_M or self._has_crests)

    def measure_calm(self, median_m: float, deviation_m: float) -> None:
        """Set the height that makes an object, or find crests that the lowest echoes of cells do not show.

        Parameters
        ----------
        median_m, deviation_m : float
            Median height of the echoes of water above the opened surface, and their standard deviation.
        """
        self._has_crests = median_m + _CREST_DEVIATIONS * deviation_m > ROUGH_M
        self._height_m = float(np.clip(median_m + _CALM_DEVIATIONS * deviation_m, _CALMEST_M, CALM_M))

    @property
    def is_doubtful(self) -> bool:
        """Whether land was looked for, and nothing, or only the shape of the water, distinguishes it from water."""
        params = self.params
        looked = isinstance(params, SeparationParams) and params.follows_waves and params.land != "ignore"
        return looked and (self.shores is None or self.shores.is_doubtful)

    @property
    def object_height_m(self) -> float:
        """Height above the surface from which an object stands out by height alone; on rough water, the median."""
        return self._limits.alone_m if self.followed else self._height_m

    @property
    def land_by_block(self) -> Mapping[tuple[int, int], Mask] | None:
        """Cells of land squares by block; None if land was not looked for."""
        if self.shores is None:
            return None
        return {block: self.shores.land[slot] for block, slot in self._grid.blocks.items()}

    @property
    def ditches_by_block(self) -> Mapping[tuple[int, int], Cells]:
        """Level of the water in ditches by block; NaN elsewhere."""
        if self.shores is None:
            return {}
        return {block: self.shores.ditch_m[slot] for block, slot in self._grid.blocks.items()}

    @property
    def levels_by_block(self) -> Mapping[tuple[int, int], Cells] | None:
        """Level of the nearest body of water by block; None if none is known."""
        if self.shores is None or not self.shores.bodies:
            return None
        return {block: self.shores.level_m[slot] for block, slot in self._grid.blocks.items()}

    @property
    def all_land_by_block(self) -> Mapping[tuple[int, int], Mask]:
        """Cells of land, also of islands and the banks of ditches, by the blocks that contain any."""
        cells = self._land | self._islands | self._ditches
        land = {block: cells[slot] for block, slot in self._grid.blocks.items()}
        return {block: own for block, own in land.items() if own.any()}

    @property
    def cells(self) -> int:
        """Number of cells with points."""
        return int(np.isfinite(self._grid.lowest).sum())
