"""Every test that docs/reliability.md names is there."""

import ast
import re

import pytest

from reliability_table import TableRow, counted, table


def test_the_table_has_a_row_for_each_class_of_fault() -> None:
    rows = table()
    assert len(rows) > 40
    assert len({row.fault for row in rows}) == len(rows)


@pytest.mark.parametrize("row", table(), ids=lambda row: row.fault[:40])
def test_the_tests_of_a_row_are_there(row: TableRow) -> None:
    assert row.tests
    for path, function in row.tests:
        assert path.is_file()
        functions = {
            node.name
            for node in ast.walk(ast.parse(path.read_text("utf-8")))
            if isinstance(node, ast.FunctionDef)
        }
        assert not function or function in functions, f"{path.name} has no {function}"


def test_rows_whose_cases_are_tests_have_as_many_as_pytest_finds() -> None:
    counting = ("numbers of a session", "DICOM that", "DICOM: gaps")
    rows = [row for row in table() if row.fault.startswith(counting)]
    found = counted({path for row in rows for path, _ in row.tests})
    told = {row.fault: int(re.findall(r"\d+", row.cases)[0]) for row in rows}
    assert told == {row.fault: sum(found[test] for test in row.tests) for row in rows}
    assert len(told) == len(counting)
