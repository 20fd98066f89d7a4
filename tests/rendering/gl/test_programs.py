import pytest

from napari_unpack.rendering.gl.programs import STRIDE, ShaderSource, load


def joined(files, defines=None, path="a"):
    return load(path, defines, read=files.__getitem__)


def test_an_included_file_stands_where_it_was_asked_for():
    source = joined({"a": 'one\n#include "b"\nthree', "b": "two"})
    lines = [line for line in source.code.splitlines() if not line.startswith("#line")]
    assert lines == ["one", "two", "three"]
    assert source.files == ("a", "b")


def test_a_file_is_included_once_however_often_it_is_asked_for():
    files = {"a": '#include "b"\n#include "c"\n#include "b"', "b": "B", "c": '#include "b"\nC'}
    assert joined(files).code.count("B") == 1


def test_files_that_include_each_other_are_named_in_the_error():
    with pytest.raises(ValueError, match="a -> b -> a"):
        joined({"a": '#include "b"', "b": '#include "a"'})
    with pytest.raises(ValueError, match="a -> a"):
        joined({"a": '#include "a"'})


def test_a_missing_file_is_named():
    with pytest.raises(FileNotFoundError, match="no_such_thing"):
        load("lib/no_such_thing.glsl")


def test_macros_come_first():
    code = joined({"a": "body"}, {"LAYERS": 3, "NAME": "x"}).code
    assert code.splitlines()[:2] == ["#define LAYERS 3", "#define NAME x"]


def test_line_numbers_lead_back_to_the_file():
    # A compiler counts on from `#line n`: the next line is n + 1 (GLSL 1.20, section 3.3).
    source = joined({"a": 'one\n#include "b"\nthree', "b": "two\ntwo and a half"})
    numbers = {}
    number = 0
    for line in source.code.splitlines():
        number += 1
        if line.startswith("#line"):
            number = int(line.split()[1])
        else:
            numbers[line] = number
    first, second = STRIDE, 2 * STRIDE
    wanted = {"one": first + 1, "two": second + 1, "two and a half": second + 2, "three": first + 3}
    assert numbers == wanted


def test_a_drivers_log_is_told_in_our_file_names():
    source = ShaderSource("", ("passes/x.frag", "lib/y.glsl"))
    assert source.explain("on line 200012: error") == "on line lib/y.glsl:12: error"
    assert source.explain("0:100007(3): error") == "0:passes/x.frag:7(3): error"
    assert source.explain("0:7(3): version 300000") == "0:7(3): version 300000"
