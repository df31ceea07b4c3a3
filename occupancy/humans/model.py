"""What every model of people has in common, and the rows that one of them gives for one plan."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from occupancy.body import Point
from robots.assumption import Assumption
from robots.motion import Block

Samples = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""What was measured later: stamps (T,) [s, increasing], points (T, 20, 3) [m] with NaN where none, position
errors (T, 20) [m]."""


class Belied(NamedTuple):
    """A later sample that is not where a model said: its number, the point, by how much [m] at least."""

    sample: int
    point: Point
    excess_m: float


class HumanModel(Protocol):
    """A model of how people move.

    A model *proves* a part apart from a link iff it wrote at least one row that contains the part, and all
    its rows for that part are separated (docs/method.md, section 4). One model suffices.

    Attributes
    ----------
    name:
        Stands in every witness.
    index:
        Number of this model in the rows that it writes.
    proves:
        Mask of the parts that it can contain.
    """

    name: str
    index: int
    proves: int

    def new_sets(self) -> Block:
        """Return an empty block for the rows of this model."""
        ...

    def assumptions(self) -> tuple[Assumption, ...]:
        """List every number that the occupancies rest on."""
        ...

    def occupy(self, people: Block, slices: Block, out: Block) -> None:
        """Replace ``out`` by the space that ``people`` (PEOPLE) may fill on each of ``slices``.

        Rows hold over the whole slice, delays included. What cannot be enclosed has no row. Never raises.
        """
        ...

    def belied(self, people: Block, row: int, samples: Samples, window: tuple[float, float]) -> Belied | None:
        """Return the first later sample that contradicts what the model assumes besides speeds and lengths.

        Those with window[0] < stamp <= window[1] are looked at. Speeds and lengths of the profile are held
        against the data by :func:`occupancy.conformance.later_outside`, whatever the models.
        """
        ...

    def inferred_parts(self, present: int, t_obs: NDArray[np.float64] | None = None) -> int:
        """Mask of the parts that have a row, but one inferred from other points than their own."""
        ...


class Occupancy:
    """The rows of one model for one plan, made when somebody first asks for them."""

    def __init__(self, model: HumanModel) -> None:
        self.model = model
        self._sets = model.new_sets()
        self._asked: tuple[Block, Block] | None = None

    def begin(self, people: Block, slices: Block) -> None:
        """Take the people and slices that the rows are for; what was made before is void."""
        self._asked = (people, slices)

    @property
    def sets(self) -> Block:
        """The rows of the model."""
        if self._asked is not None:
            self.model.occupy(*self._asked, self._sets)
            self._asked = None
        return self._sets
