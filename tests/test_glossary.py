"""Names are the field's words: those that only we used do not come back."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path

from tests.support.sources import ROOT

OURS = {
    "absorbed": "masked",
    "alike": "ambiguity group",
    "alone": "open-loop block residual",
    "attempts": "forward selection",
    "belief": "model weight",
    "bench": "fitter, rig",
    "carried": "leave-one-condition-out",
    "causes": "selection",
    "cautions": "warnings",
    "chances": "model weights",
    "claim": "ranked effect",
    "drafting": "scaffold",
    "earns": "entry test",
    "evidence": "cross-validation",
    "excitation": "identifiability",
    "explanation": "fitted model",
    "foreign": "out-of-catalogue",
    "forms": "grid",
    "found": "the thing's name",
    "further": "forward selection",
    "halves": "backward elimination",
    "hidden": "secondary effect",
    "hunting": "limit cycle",
    "imitated": "masked",
    "it": "the thing's name",
    "judge": "cross-validation",
    "look": "screen",
    "lookalikes": "isolability",
    "missing": "unmodelled",
    "narrowed": "preselect",
    "needle": "narrow minimum",
    "nominal": "prior",
    "reach": "detectability",
    "reduction": "gap summary",
    "said": "diagnosed",
    "shares": "grid",
    "sight": "screening result",
    "sizes": "trial values",
    "staircase": "discontinuous",
    "stepwise": "discontinuous",
    "structured": "systematic part",
    "swapped": "swap",
    "tell": "summary",
    "telling": "summary",
    "told": "the thing's name",
    "unseen": "held out",
    "view": "linearisation",
    "where": "localisation",
    "worth": "entry test",
}
"""Words for modules, classes, public functions and JSON keys that are not used, and what is."""
KEPT = {
    "studies/withheld/generator/causes.py": "the true causes, not those that are selected",
    "studies/withheld/score.py": "names of the figures in docs/studies/blind.md",
    "studies/withheld/oracle.py": "the same, row by row",
    "studies/withheld/schema.json": "the same, as JSON",
}


def _words(name: str) -> set[str]:
    return {part.lower() for part in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)}


def _names(path: Path) -> Iterator[str]:
    yield path.stem
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and not node.name.startswith("_"):
            yield node.name


def _keys(schema: object) -> Iterator[str]:
    if isinstance(schema, dict):
        yield from schema.get("properties", {})
        for part in schema.values():
            yield from _keys(part)
    elif isinstance(schema, list):
        for part in schema:
            yield from _keys(part)


def test_modules_classes_and_functions_have_the_names_of_the_field() -> None:
    folders = ("servo_models/**", "studies/withheld/**", "fmu_src")
    for path in (path for folder in folders for path in ROOT.glob(f"{folder}/*.py")):
        if path.relative_to(ROOT).as_posix() not in KEPT:
            for name in _names(path):
                ours = _words(name) & OURS.keys()
                assert not ours, f"{path}: '{name}': {[OURS[word] for word in ours]}"


def test_keys_of_json_have_the_names_of_the_field() -> None:
    for path in ROOT.glob("*/*/schema.json"):
        if path.relative_to(ROOT).as_posix() not in KEPT:
            for key in _keys(json.loads(path.read_text(encoding="utf-8"))):
                ours = _words(key) & OURS.keys()
                assert not ours, f"{path}: '{key}': {[OURS[word] for word in ours]}"
