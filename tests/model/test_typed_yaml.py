"""Strict YAML: what is refused, and in how many words; what is taken is what PyYAML reads."""

from pathlib import Path
from typing import Annotated, Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field, PositiveFloat, TypeAdapter, ValidationError

from ortilo_drake.model.inputs.problems import plainly
from ortilo_drake.model.typed_yaml import (
    FileName,
    Frozen,
    InputError,
    Positive,
    load_yaml,
    parse_yaml,
    validate,
)


class Part(Frozen):
    size: tuple[float, float]
    count: int = 1


class Thing(Frozen):
    name: str
    weight: PositiveFloat
    part: Part | None = None


GOOD = "name: box\nweight: 2.5\npart: {size: [1.0, 2.0]}\n"


def load(text: str) -> Thing:
    return validate(Thing, parse_yaml(text, "thing.yaml"), "thing.yaml")


def test_a_good_file_becomes_a_frozen_model(tmp_path: Path) -> None:
    path = tmp_path / "thing.yaml"
    path.write_text(GOOD)
    thing = load_yaml(Thing, path)
    assert thing == Thing(name="box", weight=2.5, part=Part(size=(1.0, 2.0)))
    with pytest.raises(ValueError, match="frozen"):
        thing.name = "other"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (GOOD + "weight: 3.0\n", ["line 4", "'weight' stands twice"]),
        (GOOD.replace("{size", "{size: [3.0, 4.0], size"), ["line 3", "'size' stands twice"]),
        (GOOD + "wieght: 3.0\n", ["wieght", "unknown key", "3.0"]),
        (GOOD.replace("}", ", colour: red}"), ["part.colour", "unknown key", "red"]),
        ("nmae: box\nweight: 1.0\n", ["nmae", "unknown key"]),  # rather than "name is missing"
        ("name: box\n", ["weight", "is missing"]),
        (GOOD.replace("2.5", ".nan"), ["weight", "nan", "finite"]),
        (GOOD.replace("2.5", ".inf"), ["weight", "inf", "finite"]),
        (GOOD.replace("2.0", "-.inf"), ["part.size.1", "-inf", "finite"]),
        (GOOD.replace("2.5", "'2.5'"), ["weight", "'2.5'", "number"]),
        (GOOD.replace("2.5", "heavy"), ["weight", "'heavy'", "number"]),
        (GOOD.replace("2.5", "yes"), ["weight", "True", "number"]),
        (GOOD.replace("2.5", "-2.5"), ["weight", "-2.5", "above 0"]),
        (GOOD.replace("[1.0, 2.0]", "[1.0]"), ["part.size.1", "missing"]),
        (GOOD.replace("[1.0, 2.0]", "7"), ["part.size", "7"]),
        (GOOD.replace("}", ", count: 1.5}"), ["part.count", "1.5", "integer"]),
        (GOOD.replace("2.5", "2024-01-01"), ["date"]),
        ("1: box\n", ["line 1", "key 1 is not a name"]),
        ("name: [box\n", ["not valid YAML"]),
        ("name: !!python/object/apply:os.getcwd []\n", ["not valid YAML"]),
        ("- name\n- weight\n", ["group"]),
        ("just text\n", ["group"]),
        ("", ["name", "is missing"]),
    ],
)
def test_whatever_is_wrong_takes_one_line_with_file_field_and_value(text: str, words: list[str]) -> None:
    with pytest.raises(InputError) as refusal:
        load(text)
    line = str(refusal.value)
    assert line.startswith("thing.yaml: ")
    assert "\n" not in line
    for word in words:
        assert word in line


def test_files_that_cannot_be_read_are_refused(tmp_path: Path) -> None:
    latin = tmp_path / "latin.yaml"
    latin.write_bytes("name: Schachtel für Äpfel\n".encode("latin-1"))
    for path, word in ((tmp_path / "none.yaml", "No such file"), (tmp_path, "directory"), (latin, "UTF-8")):
        with pytest.raises(InputError, match=word) as refusal:
            load_yaml(Thing, path)
        assert str(refusal.value).startswith(f"{path}: cannot be read: ")
        assert "\n" not in str(refusal.value)


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(st.characters(codec="ascii")),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text("abcdef", min_size=1), inner, max_size=3),
    max_leaves=10,
)


@given(PLAIN)
def test_what_yaml_writes_is_read_back(data: object) -> None:
    assert parse_yaml(yaml.safe_dump(data), "any") == data


@given(st.text(max_size=60))
def test_whatever_text_is_refused_takes_one_line(text: str) -> None:
    # No text of 60 random characters is a Thing, which needs two names; and no other error may escape.
    with pytest.raises(InputError) as refusal:
        load(text)
    assert len(str(refusal.value).splitlines()) == 1


def test_aliases_are_refused_before_they_multiply() -> None:
    bomb = "a0: &a0 [x]\n" + "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 11))
    with pytest.raises(InputError, match=r"line 2: aliases are not allowed"):
        parse_yaml(bomb, "bomb")


class Lens(Frozen):
    focus: Positive = 1.0
    file: FileName = "lens.yaml"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("focus: 1.0e-12", None),
        ("focus: 3.5", None),
        ("focus: 9.9e-13", "focus: 9.9e-13: must be at least 1e-12"),
        ("focus: 0.0", "focus: 0.0: "),
        ("focus: 1e-3x", "focus: '1e-3x': must be a number"),
        ("focus: [1, 2]", "focus: [1, 2]: must be a number"),
        ("focus: 1e3", "focus: '1e3': is text to YAML; a number has a point and a signed exponent"),
        ("file: a", None),
        ("file: ''", "file: '': "),
        (f"file: {1024 * 'a'}", None),
        (f"file: {1025 * 'a'}", "file: 'aaa"),
    ],
)
def test_what_a_positive_number_and_a_file_name_may_be(text: str, problem: str | None) -> None:
    if problem is None:
        validate(Lens, parse_yaml(text, "lens.yaml"), "lens.yaml")
        return
    with pytest.raises(InputError) as error:
        validate(Lens, parse_yaml(text, "lens.yaml"), "lens.yaml")
    assert str(error.value).startswith(f"lens.yaml: {problem}")


def test_an_unknown_key_is_answered_with_the_keys_of_its_own_group() -> None:
    with pytest.raises(InputError, match=r"part\.cuont: unknown key .*did you mean 'count'"):
        load(GOOD.replace("size: [1.0, 2.0]", "size: [1.0, 2.0], cuont: 2"))
    with pytest.raises(InputError, match=r"part\.zzz: unknown key .*known are size, count$"):
        load(GOOD.replace("size: [1.0, 2.0]", "size: [1.0, 2.0], zzz: 2"))
    with pytest.raises(InputError, match=r"count: unknown key .*did you mean 'part.count'"):
        load(GOOD + "count: 2\n")  # of a group within


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a: " + 31 * "[" + 31 * "]", None),
        ("a: " + 32 * "[" + 32 * "]", "line 1: nested more than 32 deep"),
        ("a:\n" + 40 * " - [1, {b: 2}]\n", None),  # groups one after another are not nested
        ("a: &x 1\nb: *x", "line 2: aliases are not allowed"),
    ],
)
def test_groups_may_be_nested_thirty_two_deep(text: str, problem: str | None) -> None:
    if problem is None:
        assert parse_yaml(text, "thing.yaml") == yaml.safe_load(text)
        return
    with pytest.raises(InputError, match=problem):
        parse_yaml(text, "thing.yaml")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a: 010", "line 1: 010 is 8 to YAML"),
        ("b: 1\na: 1:30", "line 2: 1:30 is 90 to YAML"),
        ("a: 1:30.5", "line 1: 1:30.5 is 90.5 to YAML"),
        ("a:\n\tb: 1", "line 2, column 1: a tab, but YAML indents by spaces"),
    ],
)
def test_what_yaml_reads_otherwise_than_people_is_refused(text: str, problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        parse_yaml(text, "thing.yaml")
    assert parse_yaml("[0, 10, -3, 0x10, 0.5, 1_000, '010']", "thing.yaml") == [0, 10, -3, 16, 0.5, 1000, "010"]


@pytest.mark.parametrize(
    ("model", "value", "said"),
    [
        (int, "x", "must be an integer"),
        (float, "20cm", "must be a number"),
        (int, 1.5, "must be an integer"),
        (Annotated[float, Field(ge=0.001)], -1, "must be at least 0.001"),
        (Annotated[list[int], Field(min_length=1)], [], "must have at least 1 item, not 0"),
    ],
)
def test_a_message_says_what_the_input_must_be(model: Any, value: Any, said: str) -> None:
    """Pydantic's own words are its own: "Input should be a valid integer, unable to parse string as an integer"."""
    with pytest.raises(ValidationError) as refused:
        TypeAdapter(model).validate_python(value)
    assert plainly(refused.value.errors()[0]["msg"]) == said
