"""Where a run stands between two steps: what its loops need to go on from there."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class Position:
    """Which load step a run is in, and how far.

    Attributes:
        load_step: number of it among all of the case, from 0; after the last one their count.
        begun: whether it has begun; else the next four belong to the one before.
        count: steps, or rows of an explicit stage, that are made.
        time: s, driven: m, row: number of its first row, from 0: at its start.
        done: share of the present implicit step that is made, above 0 if it has been cut;
            piece: share that is tried next; failures: attempts at it that did not converge;
            wasted: their iterations; step_time: s, step_driven: m, at the step's start.
        elapsed: s, of the load step, at which the next explicit time steps begin; within: how many
            the present interval has had.
    """

    load_step: int = 0
    begun: bool = False
    count: int = 0
    time: float = 0.0
    driven: float = 0.0
    row: int = 0
    done: float = 0.0
    piece: float = 1.0
    failures: int = 0
    wasted: int = 0
    step_time: float = 0.0
    step_driven: float = 0.0
    elapsed: float = 0.0
    within: int = 0

    def begin(self, time: float, driven: float, row: int) -> bool:
        """Begin the load step here, unless it has begun; returns whether it has not."""
        if self.begun:
            return False
        self.begun, self.count, self.elapsed, self.within = True, 0, 0.0, 0
        self.time, self.driven, self.row, self.done = time, driven, row, 0.0
        return True

    def begin_step(self, time: float, driven: float) -> None:
        """Begin an implicit step here, unless a part of it is made or has been tried."""
        if self.done == 0.0 and not self.failures:
            self.piece, self.step_time, self.step_driven = 1.0, time, driven

    def try_again(self) -> None:
        """Forget the attempts at the rest of the present implicit step, which was given up."""
        self.piece, self.failures, self.wasted = 1.0, 0, 0

    def end(self) -> None:
        """Go on to the next load step."""
        self.load_step += 1
        self.begun = False
