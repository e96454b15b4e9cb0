"""Every command of `dohyo`: its words, where it is, and its line in the help."""

from __future__ import annotations

from dohyo.service.cli.lazy import Command, Group

COMMANDS: dict[str, Command | Group] = {
    "networks": Group(
        "Road networks.",
        {
            "list": Command("lists:list_networks", "Lists the networks that come with dohyo, and those you imported."),
            "show": Command("networks:show", "Draws a network as a road map."),
            "check": Command(
                "networks:check", "Reports what a network holds, and what about it would trouble a driver."
            ),
            "import": Command("networks:import_file", "Imports a road network into your catalog, and checks it."),
            "build": Command(
                "networks:build", "Builds a network from plain XML; the same source gives the same bytes."
            ),
        },
    ),
    "agents": Group("Driving agents.", {"list": Command("lists:list_agents", "Lists the registered agents.")}),
    "benchmarks": Group(
        "Benchmarks.",
        {
            "list": Command("lists:list_benchmarks", "Lists the benchmarks."),
            "prepare": Command(
                "prepare:prepare",
                "Makes the recorded runs that a benchmark replays, or its days; the same command goes on where it "
                "stopped.",
                resumes=True,
            ),
            "import": Command(
                "routes:import_file",
                "Makes a benchmark of the routes in a CARLA route file, one mission per route.",
            ),
        },
    ),
    "evaluate": Command(
        "evaluate:evaluate",
        "Evaluates an agent on a benchmark. The same command again goes on where it stopped.",
        resumes=True,
    ),
    "report": Command("records:report", "Compares evaluations: a table here, and one self-contained HTML file."),
    "verify": Command("records:verify", "Replays an episode and compares the hashes; exit code 1 where they differ."),
    "score": Command("records:score", "Recomputes every score from the raw events."),
    "explain": Command(
        "explain:explain",
        "Shows why an agent acted as it did at one moment of a record: the explanation as JSON, or the search drawn.",
    ),
    "localize": Command(
        "localize:localize", "Estimates a vehicle's track from its IMU and GNSS logs; it must stand level at first."
    ),
    "serve": Command("serve:serve", "Runs the service until SIGTERM or Ctrl-C, then lets running episodes end."),
    "worker": Command(
        "worker:worker",
        "Drives an agent's episodes for a service until it is stopped. Submits the agent first, where it is not known.",
        resumes=True,
    ),
    "submit": Command(
        "remote:submit",
        "Submits a version of an agent: a built-in one, an ONNX policy, or one that drives from elsewhere.",
    ),
    "evaluations": Group(
        "Evaluations at a service.",
        {
            "start": Command("remote:start", "Queues an evaluation."),
            "list": Command("remote:show_all", "Lists evaluations, the newest first."),
            "watch": Command(
                "remote:watch",
                "Waits until an evaluation has ended, and prints its scores; exit code 1 where it was not completed.",
                resumes=True,
            ),
            "fetch": Command(
                "remote:fetch",
                "Saves its records as `dohyo evaluate` would have: for `dohyo report`, `score` and `verify`.",
            ),
            "cancel": Command("remote:cancel", "Ends an evaluation; its finished episodes stay."),
            "resume": Command("remote:resume", "Drives again what was lost or cancelled."),
        },
    ),
    "leaderboard": Command("remote:leaderboard", "Shows who drives best at a service."),
    "tokens": Group(
        "Tokens of the service.",
        {
            "create": Command("tokens:create", "Makes a token and prints it; it cannot be shown again."),
            "list": Command("tokens:show_all", "Lists tokens, without their secrets."),
            "revoke": Command("tokens:revoke", "Ends a token for good, at once."),
        },
    ),
    "dataset": Group(
        "Datasets for learning.",
        {
            "motion": Command(
                "dataset:motion",
                "Records scenes of the autopilot among traffic, and what came of them; the same order gives the same "
                "bytes.",
                resumes=True,
            ),
            "semantic": Command(
                "dataset:semantic",
                "Takes semantic pictures from disturbed drives of the autopilot; the same order gives the same bytes.",
                resumes=True,
            ),
            "freeway": Command(
                "dataset:freeway",
                "Makes days of segment speeds on the freeway, minute by minute; each day is written when it is whole.",
                resumes=True,
            ),
        },
    ),
    "train": Command(
        "train:train",
        "Trains what learns: checkpoints, curves, held-out evaluations, and the actor as safetensors and ONNX.",
    ),
    "forecast": Group(
        "Forecasts of traffic speeds.",
        {
            "fit": Command(
                "forecast:fit",
                "Learns from the earlier part of the data, and prints the errors on the part it has not seen.",
            ),
            "evaluate": Command(
                "forecast:evaluate",
                "Prints the errors of a trained forecaster, and those of persistence beside them.",
            ),
        },
    ),
}
