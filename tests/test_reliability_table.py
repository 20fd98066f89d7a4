"""Every test that docs/reliability.md names is there."""

import ast

import pytest

from reliability_table import TableRow, table


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
