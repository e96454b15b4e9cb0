"""What is shown of an episode that was cancelled or lost."""

from __future__ import annotations

from dohyo.service.evaluations.model import EpisodeStatus, EvaluationStatus
from dohyo.service.evaluations.queries import list_episodes
from tests.service.harness import Harness, finish


def test_only_lost_episodes_say_why_they_were_lost(stored: Harness) -> None:
    """A cancelled one keeps the reason of its last attempt, such as that no worker came."""
    team = stored.caller("team")
    team.agent("a")
    evaluation = team.evaluation("a")
    with stored.services.database.session() as session:
        for episode, status in zip(
            list_episodes(session, evaluation), (EpisodeStatus.LOST, EpisodeStatus.CANCELLED), strict=False
        ):
            episode.status, episode.failure, episode.attempts = status, "no worker came for the episode", 0
    finish(stored.services.database, evaluation, EvaluationStatus.CANCELLED, EpisodeStatus.CANCELLED)
    lost, cancelled, *_ = team.get(f"/v1/evaluations/{evaluation}/episodes").json()["items"]
    assert (lost["status"], lost["failure"]) == ("lost", "no worker came for the episode")
    assert (cancelled["status"], cancelled["failure"]) == ("cancelled", None)
    assert team.get(f"/v1/episodes/{cancelled['id']}").json()["failure"] is None
    described = stored.client.get("/openapi.json").json()["components"]["schemas"]["EpisodeView"]["properties"]
    assert "`unclaimed` or `drained`" in described["attempts"]["description"]
