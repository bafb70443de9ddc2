"""What Pezzementi, Reyda and Hager (2011) report, as rows of the table of the task that has their protocol.

The numbers are those of the paper's text (sections IV and V). Its curves, figures 6 and 7, are pictures, from which
nothing is read here. The paper has ten trials for each of five real letters, and neither intervals nor trials to
compare with: its rows are never ranked.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

TASK = "letters-v1"


@dataclass(frozen=True)
class PaperRow:
    """A method of the paper.

    accuracy: share of the trials that were right, by the reading after which the text states it; it holds from there
    on. where: the place in the paper, and what else it says there.
    """

    method: str
    accuracy: Mapping[int, float]
    where: str

    def accuracy_after(self, reading: int) -> float | None:
        """Give the accuracy that the text states for this many readings or fewer; None if it states none."""
        stated = [at for at in self.accuracy if at <= reading]
        return self.accuracy[max(stated)] if stated else None


ROWS = (
    PaperRow(
        "histogram, 10,000 bins (paper)",
        {9: 1.0},
        "1.00 after 9 readings; objects within 1.3 mm on average, after how many it does not say: section V",
    ),
    PaperRow(
        "histogram, 1,000 bins (paper)",
        {46: 1.0},
        "1.00 after 46 readings: section V; about 50 in section IV",
    ),
    PaperRow(
        "particle, 10,000 particles (paper)",
        {10: 0.74},
        "levels out at 0.74 after around 10 readings: section IV",
    ),
)
