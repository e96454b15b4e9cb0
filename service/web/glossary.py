"""Descriptions of properties: from the docstrings of their classes, or by name, since one name has one meaning."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, Final

from pydantic import BaseModel

WORDS: Final = {
    "agent": "Name of the agent.",
    "benchmark": "Name of the benchmark.",
    "benchmark_hash": "Content hash of the benchmark's version.",
    "cell": "Part of the benchmark with one network, traffic and conditions.",
    "cells": "The same by cell.",
    "comes_from": "Side from which the vehicle comes, seen from the ego.",
    "control": "Interface that turns an action into drive and steering.",
    "created": "Time of creation.",
    "crossings": "Number of pedestrian crossings.",
    "description": "Text for readers.",
    "detail": "What was expected and what came, in one line.",
    "dohyo": "Version of dohyo.",
    "drives": "Drives, one for each ego of each episode.",
    "ego": "Name of the ego's mission.",
    "entry": "Class of the agent, or its name among the built-in ones.",
    "episode": "Identifier of the episode.",
    "episodes": "Number of finished episodes.",
    "errors": "Each place of the request that cannot be used, and what was expected there.",
    "evaluation": "Identifier of the evaluation.",
    "evaluations": "Evaluations.",
    "expires": "Time after which it is no longer valid; null: never.",
    "explanations": "The agent's own words and numbers about the decision.",
    "files_sha256": "Hash of the files that the agent reads, such as weights.",
    "finalised": "Time at which the board became final; null: it may still change.",
    "first_evaluated": "Time of the first evaluation on this server.",
    "high": "Upper end of the 95 % interval.",
    "id": "Identifier.",
    "infractions": "Violations of rules, in the order of time.",
    "irs_lambda": "Weight of infractions in the infraction rate score.",
    "irs_length": "Length in the infraction rate score: of the route completed, driven, or of the whole route.",
    "items": "Items of this page.",
    "kind": "Kind.",
    "km": "Length of route completed in all drives, km.",
    "lane_km": "Length of all lanes, km.",
    "licence": "Licence of the road data.",
    "lights": "Number of junctions with traffic lights.",
    "lost": "Drives without a result, by no fault of the agent.",
    "low": "Lower end of the 95 % interval.",
    "mean": "Mean over drives.",
    "name": "Name.",
    "network": "Name of the road network.",
    "network_sha256": "Hash of the road network's files.",
    "networks": "Names of the road networks.",
    "outcome": "Result; null before the end.",
    "owner": "Owner.",
    "per_km": "Infractions per km of route completed by kind, with intervals.",
    "policy_sha256": "Hash of the uploaded policy; null for other kinds.",
    "record": "Version of the format of records.",
    "revoked": "Time of the revocation; null: it is valid.",
    "route_m": "Arc length on the ego's route, m.",
    "rules": "Version of the rules that the scores follow.",
    "same": "Whether both have the same hash.",
    "scenario": "Name of the scenario.",
    "scores": "Scores with 95 % intervals.",
    "seed": "Seed of the scenario.",
    "seeds": "Seeds of the scenarios.",
    "sensors": "Names of the sensors that the agent observes.",
    "settings": "Settings of the agent.",
    "source": "Origin of the road data.",
    "source_sha256": "Hash of the agent's source files.",
    "start_speed_mps": "Speed at the start, m/s.",
    "status": "Status.",
    "statuses": "Number of drives by status.",
    "sumo": "Version of SUMO.",
    "tick": "Number of ticks of 0.1 s since the start.",
    "ticks": "Ticks at which the agent decided.",
    "time_s": "Simulated time since the ego's start, s.",
    "title": "Title.",
    "token": "Secret of the token, shown only once.",
    "track": "Sensors that are allowed: `sensors`, `map` or `privileged`.",
    "type": "Kind of problem; about:blank: the status says all.",
    "url": "Address that is called.",
    "version": "Number of the version.",
    "via": "Edges that the route passes.",
    "x_m": "Position to the east in the network frame, m.",
    "y_m": "Position to the north in the network frame, m.",
}

PARAMETERS: Final = {
    "after": "The `next` of the page before.",
    "agent": "Only those of this agent.",
    "benchmark": "Only those of this benchmark.",
    "control": "Interface of the actions; by default all.",
    "identifier": "Its identifier.",
    "lease": "Identifier of the lease.",
    "seat": "Identifier of the place in a world.",
    "sensors": "Names of sensors; by default all.",
    "status": "Only those of this status.",
    "track": "Only those of this track.",
    "version": "Number of the version.",
    "worker_id": "Identifier of the worker.",
}


def describe_parameters(paths: dict[str, dict[str, Any]]) -> None:
    """Describes all parameters that have no description of their own."""
    for operation in (one for methods in paths.values() for one in methods.values()):
        for parameter in operation.get("parameters", ()):
            if parameter["name"] in PARAMETERS:
                parameter.setdefault("description", PARAMETERS[parameter["name"]])


def describe_schemas(schemas: dict[str, dict[str, Any]]) -> None:
    """Describes all properties that have no description of their own, and ends the classes' texts before attributes."""
    classes = {one.__name__: one for one in _subclasses(BaseModel) if one.__module__.startswith("dohyo.")}
    for name, schema in schemas.items():
        text, known = split_docstring(schema.get("description", ""))
        if text:
            schema["description"] = text
        for base in classes[name].__mro__ if name in classes else ():
            known = split_docstring(base.__doc__ or "")[1] | known
        for key, described in schema.get("properties", {}).items():
            meaning = known.get(key) or WORDS.get(key)
            if "$ref" not in described and meaning:
                described.setdefault("description", meaning)


def split_docstring(text: str) -> tuple[str, dict[str, str]]:
    """A docstring without its section `Attributes:`, and the meanings of the attributes."""
    # Docstrings of classes are indented, those of schemas are not.
    head, _, section = re.sub(r"\n    (?=\S|    )", "\n", text).partition("\n\nAttributes:\n")
    entries = re.findall(r"^    (\w+): (.*(?:\n {6,}\S.*)*)", section.partition("\n\n")[0], re.MULTILINE)
    return head.strip(), {name: " ".join(meaning.split()) for name, meaning in entries}


def _subclasses(kind: type[BaseModel]) -> Iterator[type[BaseModel]]:
    for one in kind.__subclasses__():
        yield one
        yield from _subclasses(one)
