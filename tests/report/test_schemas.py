"""Documents keep to the schemas that their structures give, and the stored ones are these."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from jsonschema import ValidationError

import servo_models as sm
from servo_models.identification.document import (
    CheckDocument,
    IdentificationDocument,
    OutcomeDocument,
)
from servo_models.report.document import Document, schema_of
from servo_models.validation.rows import MODEL, CostCurve, CostPoint, Validation, judged
from servo_models.validation.sections import ValidationDocument
from servo_models.withheld.run import Check
from servo_models.withheld.sections import CheckDocument as WithheldDocument
from studies.schemas import FILES
from tests.support.noisy_motor import described, frame, motor_log
from tests.support.schemas import check_schema
from tests.support.withheld_cases import MADE

KINDS = (
    CheckDocument,
    OutcomeDocument,
    IdentificationDocument,
    ValidationDocument,
    WithheldDocument,
)
Documents = dict[type[Document], dict[str, Any]]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.parent.name)
def test_a_stored_schema_is_that_of_the_document(path: Path) -> None:
    """Else: python -m studies schemas."""
    assert json.loads(path.read_text("utf-8")) == schema_of(FILES[path])


@pytest.fixture(scope="module")
def documents(tmp_path_factory: pytest.TempPathFactory) -> Documents:
    csv = tmp_path_factory.mktemp("rig") / "bench log.csv"
    frame(motor_log()).write_csv(csv)
    identified = sm.identify(described(csv))
    row = judged(MODEL, ("a", "b", "step"), "rate", 3.7e-6, 1e-5)
    cost = CostCurve("a", "b", "step", 1e-3, (CostPoint(1e-3, {"rate": 1e-9}, 0.1),))
    results = (
        sm.check(described(csv)),
        identified,
        identified.result,
        Validation((row, replace(row, value=math.nan)), (cost,), {"Python": "3.11"}),
        Check(1, ("easy",), "0" * 64, MADE),
    )
    return {kind: json.loads(result.to_json()) for kind, result in zip(KINDS, results)}


@pytest.mark.parametrize("kind", KINDS)
def test_a_document_keeps_to_its_schema(kind: type[Document], documents: Documents) -> None:
    check_schema(documents[kind], kind)


@pytest.mark.thorough
@pytest.mark.parametrize("kind", KINDS)
def test_a_schema_refuses_another_document(kind: type[Document], documents: Documents) -> None:
    whole = documents[kind]
    wrong: list[dict[str, Any]] = [{**whole, "more": 1}]
    for name, value in whole.items():
        wrong.append({**whole, name: "no list" if isinstance(value, list) else []})
        wrong.append({key: value for key, value in whole.items() if key != name})
    for document in wrong:
        with pytest.raises(ValidationError):
            check_schema(document, kind)


def test_a_figure_that_does_not_exist_is_null(documents: Documents) -> None:
    assert [row["value"] for row in documents[ValidationDocument]["rows"]] == [3.7e-6, None]
