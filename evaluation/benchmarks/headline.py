"""Headline: the score by which a benchmark ranks agents."""

from __future__ import annotations

from enum import StrEnum


class Headline(StrEnum):
    """Scores that can rank agents; a value is the score's name in summaries, in the API and on leaderboards."""

    DRIVING_SCORE = "driving_score"
    IRS = "irs"
    SUCCESS = "success"
    NOCRASH_SUCCESS = "nocrash_success"
    DROVE_2500M = "drove_2500m"
    CLOSED_LOOP = "closed_loop"

    @property
    def label(self) -> str:
        """Name of the score, for people."""
        return _LABELS[self]


_LABELS = {
    Headline.DRIVING_SCORE: "driving score",
    Headline.IRS: "infraction rate score",
    Headline.SUCCESS: "success",
    Headline.NOCRASH_SUCCESS: "NoCrash success",
    Headline.DROVE_2500M: "2500 m",
    Headline.CLOSED_LOOP: "closed-loop score",
}
