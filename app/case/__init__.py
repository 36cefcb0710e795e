"""The case file: its tables, read, checked and completed with defaults, in SI."""

from app.case.case import Case, check_case, json_schema, load_case, resolved_toml

__all__ = ["Case", "check_case", "json_schema", "load_case", "resolved_toml"]
