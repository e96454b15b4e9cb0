"""The root command, and what happens to errors."""

from __future__ import annotations

import sys

import typer

from dohyo.service.cli import (
    catalogs,
    dataset,
    evaluate,
    explain,
    forecast,
    localize,
    networks,
    records,
    remote,
    routes,
    serve,
    tokens,
    train,
    worker,
)
from dohyo.sumo_networks.errors import DohyoError

BAD_INPUT, INTERRUPTED = 2, 130

app = typer.Typer(
    name="dohyo",
    help="Evaluates driving agents in SUMO traffic: real city networks, reproducible scores.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.add_typer(networks.networks, name="networks")
app.add_typer(catalogs.agents, name="agents")
app.add_typer(catalogs.benchmarks, name="benchmarks")
catalogs.benchmarks.command("import")(routes.import_file)
app.command("evaluate")(evaluate.evaluate)
app.command("report")(records.report)
app.command("verify")(records.verify)
app.command("score")(records.score)
app.command("explain")(explain.explain)
app.command("localize")(localize.localize)
app.command("serve")(serve.serve)
app.command("worker")(worker.worker)
app.command("submit")(remote.submit)
app.add_typer(remote.evaluations, name="evaluations")
app.command("leaderboard")(remote.leaderboard)
app.add_typer(tokens.tokens, name="tokens")
app.add_typer(dataset.dataset, name="dataset")
app.command("train")(train.train)
app.add_typer(forecast.forecast, name="forecast")


def main() -> None:
    """Runs the command line; whatever dohyo refuses becomes one line and exit code 2."""
    try:
        app()
    except DohyoError as error:
        print(f"dohyo: {error}", file=sys.stderr)
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        print("dohyo: interrupted; the same command goes on where this one stopped", file=sys.stderr)
        sys.exit(INTERRUPTED)
