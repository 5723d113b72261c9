"""python -m studies schemas: write the JSON Schemas that users read, from the documents."""

from __future__ import annotations

from json import dumps
from pathlib import Path

from servo_models.diagnosis.schema import DiagnosisDocument
from servo_models.files import write_whole
from servo_models.report.document import Document, schema_of
from servo_models.withheld.sections import CheckDocument

ROOT = Path(__file__).parents[1]
FILES: dict[Path, type[Document]] = {
    ROOT / "servo_models" / "diagnosis" / "schema.json": DiagnosisDocument,
    ROOT / "servo_models" / "withheld" / "schema.json": CheckDocument,
}


def text_of(kind: type[Document]) -> str:
    """Return the schema of a document as a file: one line a structure."""
    schema = schema_of(kind)
    parts = ",\n".join(
        f"{dumps(name)}: {dumps(part)}" for name, part in schema.pop("$defs").items()
    )
    return f'{dumps(schema)[:-1]}, "$defs": {{\n{parts}}}}}\n'


if __name__ == "__main__":
    for path, kind in FILES.items():
        write_whole(path, text_of(kind).encode())
