"""Table of all commands of `dohyo`: words, function and help line."""

from __future__ import annotations

from dohyo.service.cli.lazy import Command, Group

COMMANDS: dict[str, Command | Group] = {
    "networks": Group(
        "Road networks.",
        {
            "list": Command("network_list:list_networks", "Lists the networks of dohyo and those you imported."),
            "show": Command("networks:show", "Draws a network as a road map."),
            "check": Command(
                "networks:check",
                "Reports a network's size, faults that would disturb a driver, and how much traffic it carries.",
            ),
            "import": Command("networks:import_file", "Imports a road network into your catalog, and checks it."),
            "build": Command(
                "networks:build", "Builds a network from plain XML; the same source gives the same bytes."
            ),
        },
    ),
    "agents": Group(
        "Driving agents.",
        {
            "list": Command("agent_list:list_agents", "Lists the registered agents."),
            "show": Command("agent_list:show", "Shows the settings of an agent: types, ranges and defaults."),
        },
    ),
    "benchmarks": Group(
        "Benchmarks.",
        {
            "list": Command("benchmark_list:list_benchmarks", "Lists the benchmarks."),
            "prepare": Command(
                "prepare:prepare",
                "Makes a benchmark's recorded runs or days. Run again, it continues where it stopped.",
                resumes=True,
            ),
            "create": Command(
                "create:create", "Creates a benchmark on any network: draws missions, and writes one TOML file."
            ),
            "import": Command(
                "routes:import_file",
                "Makes a benchmark of the routes in a CARLA route file, one mission per route.",
            ),
        },
    ),
    "evaluate": Command(
        "evaluate:evaluate",
        "Evaluates agents on a benchmark. Run again, it continues where it stopped.",
        resumes=True,
    ),
    "demo": Command(
        "demo:demo",
        "From a city's file to a report: imports, draws missions, drives two agents. Run again, it continues.",
        resumes=True,
    ),
    "report": Command("records:report", "Compares evaluations: a table here, and one self-contained HTML file."),
    "verify": Command(
        "records:verify",
        "Checks a record's signature and benchmark, drives the episode again and compares.",
    ),
    "score": Command("records:score", "Recomputes every score from the raw events."),
    "league": Group(
        "The league of dohyo's systems.",
        {
            "run": Command(
                "league:run",
                "Drives every entrant in every discipline. Run again, it continues where it stopped.",
                resumes=True,
            ),
            "table": Command("league_table:table", "Makes the league's page from stored rows."),
            "verify": Command(
                "league:verify",
                "Drives rows of the league again. Exit code 1 if a record's hash or a measure differs.",
            ),
        },
    ),
    "explain": Command(
        "explain:explain",
        "Explains an agent's decision at one moment of a record, as JSON or as a picture of the search.",
    ),
    "localize": Command(
        "localize:localize",
        "Estimates a vehicle's track from IMU and GNSS logs, whether it stands or drives at first.",
    ),
    "serve": Command("serve:serve", "Runs the service until SIGTERM or Ctrl-C, then lets running episodes end."),
    "worker": Command(
        "worker:worker",
        "Drives an agent's episodes for a service until stopped. Submits the agent first if needed.",
        resumes=True,
    ),
    "submit": Command(
        "remote:submit",
        "Submits a version of an agent: built-in, an ONNX policy, or remote (driven by workers).",
    ),
    "evaluations": Group(
        "Evaluations at a service.",
        {
            "start": Command(
                "remote:start", "Queues an evaluation: a practice run, which may be mixed, or a ranked one."
            ),
            "list": Command("remote:show_all", "Lists evaluations, the newest first."),
            "watch": Command(
                "remote:watch",
                "Waits for an evaluation's end and prints its scores. Exit code 1 if it was not completed.",
                resumes=True,
            ),
            "fetch": Command(
                "remote:fetch",
                "Saves an evaluation's records in a result folder, for `dohyo report`, `score` and `verify`.",
            ),
            "cancel": Command("remote:cancel", "Cancels an evaluation. Finished episodes are kept."),
            "resume": Command("remote:resume", "Queues lost and cancelled episodes again."),
        },
    ),
    "leaderboard": Command(
        "remote:leaderboard", "Shows a service's leaderboard, of a benchmark or of a phase of a challenge."
    ),
    "tokens": Group(
        "Tokens of the service.",
        {
            "create": Command("tokens:create", "Creates a token and prints it. It cannot be shown again."),
            "list": Command("tokens:show_all", "Lists tokens, without their secrets."),
            "revoke": Command("tokens:revoke", "Revokes a token at once and permanently."),
        },
    ),
    "database": Group(
        "Database of the service.",
        {
            "move": Command(
                "database:move",
                "Moves a stopped service into another database: all rows are copied, and the data folder belongs to it"
                " then.",
            ),
        },
    ),
    "dataset": Group(
        "Datasets for learning.",
        {
            "motion": Command(
                "dataset:motion",
                "Records the autopilot's traffic scenes and their outcomes. Same arguments, same bytes.",
                resumes=True,
            ),
            "semantic": Command(
                "dataset:semantic",
                "Records semantic pictures on the autopilot's disturbed drives. Same arguments, same bytes.",
                resumes=True,
            ),
            "affordances": Command(
                "dataset:affordances",
                "Records three cameras whose pose is drawn, on the autopilot's drives. Same arguments, same bytes.",
                resumes=True,
            ),
            "priboot": Command(
                "dataset:priboot",
                "Records PRIBOOT's demonstrations on disturbed drives. Same arguments, same bytes.",
                resumes=True,
            ),
            "freeway": Command(
                "dataset:freeway",
                "Simulates days of segment speeds on the freeway. Each day is written when it is complete.",
                resumes=True,
            ),
        },
    ),
    "train": Command(
        "train:train",
        "Trains a model: checkpoints, learning curves, held-out evaluations, and the actor as safetensors and ONNX.",
    ),
    "forecast": Group(
        "Forecasts of traffic speeds.",
        {
            "fit": Command(
                "forecast:fit",
                "Trains a forecaster on the earlier part of the data, and prints its errors on the rest.",
            ),
            "evaluate": Command(
                "forecast:evaluate",
                "Prints the errors of a trained forecaster beside those of persistence.",
            ),
            "run": Command(
                "forecast:run",
                "Forecasts three steps after a table's last row, with intervals that follow the model's past errors.",
            ),
        },
    ),
}
