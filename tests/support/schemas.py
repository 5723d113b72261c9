"""Hold a document to the JSON Schema of its kind."""

from __future__ import annotations

from jsonschema import Draft202012Validator

from servo_models.diagnosis.schema import DiagnosisDocument
from servo_models.report.document import Document, schema_of


def check_schema(document: object, kind: type[Document] = DiagnosisDocument) -> None:
    schema = schema_of(kind)
    Draft202012Validator.check_schema(schema)
    Draft202012Validator(schema).validate(document)
