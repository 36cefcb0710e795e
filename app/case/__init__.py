"""The case file: its tables, read, checked and completed with defaults, in SI."""

from app.case.case import Case, resolved_toml
from app.case.reading import check_case, load_case
from app.case.schema import json_schema

__all__ = ["Case", "check_case", "json_schema", "load_case", "resolved_toml"]
