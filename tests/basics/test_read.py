"""One reader for all files of users: what is no file, too large, too deep or elsewhere is refused."""

from __future__ import annotations

import ast
import os
import re
import time
from pathlib import Path

import pytest

from ocptip.basics import read
from ocptip.basics.errors import InputError
from ocptip.basics.read import (
    only_inside,
    parse_json,
    parse_toml,
    parse_xml,
    parse_yaml,
    read_bytes,
    read_json,
    read_text,
    read_xml_text,
    require_readable,
)
from studies.words.code import nodes_of

SOURCE = Path(read.__file__).parents[1]
OPENERS = {
    "open", "fdopen", "read_text", "read_bytes", "load", "loadtxt", "genfromtxt", "fromfile", "memmap",
    "imread",
    "parse", "iterparse", "fromstring", "XML", "loads", "safe_load", "safe_load_all", "buildModelFromUrdf",
    "buildGeomFromUrdf", "from_xml_path", "read_csv",
}  # fmt: skip
"""Names of functions that open or parse files."""

LOADERS = ("json", "pickle", "tomllib", "marshal")

_OF_MACHINE_CODE = "expressions", "module", "native", "values"
ELSEWHERE = {
    "basics/write.py": {"open"},  # writes
    "cli/run.py": {"open"},  # /dev/null
    "cli/start/examples.py": {"read_bytes"},  # of the package
    "cli/many.py": {"loads"},  # what this process made
    "motion/planner/jobs.py": {"loads"},  # likewise
    "numerics/jit/compiled.py": {"read_bytes"},  # the kernels' source
    "numerics/jit/lowering.py": {"parse", "load"},  # a kernel's source; an instruction
    **{f"numerics/jit/{name}.py": {"load"} for name in _OF_MACHINE_CODE},  # an instruction
    "numerics/jit/private.py": {"open", "fdopen"},  # machine code, with rules of its own
    "parallel/code/codegen.py": {"read_bytes", "read_text"},  # what this process made
    "pictures/movie.py": {"open", "read_text"},  # what this process made, of the package
    "pictures/browser/panel.py": {"read_text"},  # of the package
    "published/arms.py": {"loads", "read_text"},  # of the package
    "robots/urdf/conversion.py": {"from_xml_path"},  # MuJoCo reads its own format, after require_readable
    "robots/urdf/parser.py": {"load"},  # meshes, after require_readable
    "trajectories/bag_types.py": {"parse"},  # definitions of messages, as texts out of a bag that was read
}


def test_nothing_else_opens_or_parses_files():
    found, names = {}, "|".join(OPENERS - {"loads"})
    called = re.compile(rf"\b(?:{names}|(?:{'|'.join(LOADERS)})\.loads)\b")
    for path in sorted(SOURCE.rglob("*.py")):
        if not called.search(path.read_text(encoding="utf-8")):
            continue
        nodes = nodes_of(path)
        imported = [n for n in nodes if isinstance(n, ast.ImportFrom) and n.module == "ocptip.basics.read"]
        through = {one.name for node in imported for one in node.names}
        calls = [node.func for node in nodes if isinstance(node, ast.Call)]
        used = {call.id for call in calls if isinstance(call, ast.Name)} - through - {"loads"}
        used |= {call.attr for call in calls if isinstance(call, ast.Attribute) and _opens(call)}
        name = path.relative_to(SOURCE).as_posix()
        if name != "basics/read.py" and used & OPENERS:
            found[name] = used & OPENERS
    assert found == ELSEWHERE


def _opens(call: ast.Attribute) -> bool:
    """Contact forces and the like are `loads` too."""
    return call.attr != "loads" or ast.unparse(call.value) in LOADERS


def refused(function, *arguments):
    with pytest.raises(InputError) as caught:
        function(*arguments)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_text_of_a_file(tmp_path):
    (tmp_path / "a").write_bytes(b"\xef\xbb\xbf\xc2\xb5\n")
    assert read_text(tmp_path / "a") == "\N{MICRO SIGN}\n"
    assert read_bytes(str(tmp_path / "a"))[:3] == b"\xef\xbb\xbf"
    (tmp_path / "a").write_bytes(b"ab\xff")
    assert refused(read_text, tmp_path / "a") == f"{tmp_path / 'a'}: not a text file in UTF-8 (byte 2)"
    assert refused(read_text, tmp_path / "b") == f"{tmp_path / 'b'}: no such file"
    assert "null byte" in refused(read_text, "a\0b")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="kinds of files of POSIX")
@pytest.mark.parametrize("reader", [read_bytes, read_text, read_json, read_xml_text, require_readable])
def test_only_regular_files(reader, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for target, name in (
        ("/dev/zero", "zero"),
        (tmp_path, "folder"),
        ("pipe", "piped"),
        ("circle", "circle"),
    ):
        (tmp_path / name).symlink_to(target)
    (tmp_path / "plain").write_text("1")
    (tmp_path / "linked").symlink_to("plain")
    assert "is a pipe; expected a file" in refused(reader, tmp_path / "pipe")
    assert "is a pipe; expected a file" in refused(reader, tmp_path / "piped")
    assert "is a device; expected a file" in refused(reader, tmp_path / "zero")
    assert "is a folder; expected a file" in refused(reader, tmp_path / "folder")
    assert "is a circle of symbolic links" in refused(reader, tmp_path / "circle")
    assert "cannot be read: File name too long" in refused(reader, tmp_path / ("x" * 300))
    reader(tmp_path / "linked")  # of the user's own choice


def test_size(tmp_path):
    with (tmp_path / "a").open("wb") as stream:
        stream.truncate(2**40)  # takes no room
    assert "is too large: expected at most 512 MiB, got 1048576" in refused(read_bytes, tmp_path / "a")
    (tmp_path / "b").write_bytes(b"1234")
    assert read_bytes(tmp_path / "b", 4) == b"1234"
    assert "is too large" in refused(read_bytes, tmp_path / "b", 3)
    if Path("/proc/self/status").exists():  # has no size
        assert "is too large" in refused(read_bytes, "/proc/self/status", 10)


@pytest.fixture
def inside(tmp_path):
    folder = tmp_path / "plan"
    (folder / "task").mkdir(parents=True)
    (folder / "task" / "a").write_text("a")
    (tmp_path / "secret").write_text("secret")
    with only_inside(folder):
        yield folder


@pytest.mark.parametrize("name", ["../secret", "task/../../secret", "/etc/hostname", ".", "task/../.."])
def test_nothing_outside_of_a_folder(inside, name):
    assert "outside of the folder" in refused(read_bytes, inside / name)


def test_no_links_within_a_folder(inside, tmp_path):
    (inside / "file").symlink_to("../secret")
    (inside / "near").symlink_to("task/a")
    (inside / "folder").symlink_to(tmp_path)
    (inside / "task" / "self").symlink_to(".")
    for name in ("file", "near", "folder/secret", "task/self/a"):
        assert "is or is below a symbolic link" in refused(read_bytes, inside / name)
    assert read_bytes(inside / "task" / "a") == b"a"
    assert read_bytes(inside / "task" / ".." / "task" / "a") == b"a"
    assert "no such file" in refused(read_bytes, inside / "task" / "b")
    assert "is a folder" in refused(read_bytes, inside / "task")


def test_the_folder_itself_may_be_a_link(inside, tmp_path, monkeypatch):
    (tmp_path / "link").symlink_to(inside)
    monkeypatch.chdir(tmp_path)
    with only_inside("link"):
        assert read_bytes("link/task/a") == b"a"
        assert read_bytes(inside / "task" / "a") == b"a"  # by its other name
        assert "outside" in refused(read_bytes, "secret")
    assert read_bytes(inside / "task" / "a") == b"a"


def test_too_few_file_handles_are_not_the_files_fault(tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(24, "Too many open files")

    monkeypatch.setattr(read.os, "open", full)
    with pytest.raises(OSError, match="Too many open files") as caught:
        read_bytes(tmp_path / "a")
    assert not isinstance(caught.value, InputError)
    assert caught.value.filename == str(tmp_path / "a")


DEEP = 100_000


@pytest.mark.parametrize(
    ("parse", "text"),
    [
        (parse_json, "[" * DEEP),
        (parse_json, "[" * 150 + "]" * 150),
        (parse_json, '{"a":' * 150 + "1" + "}" * 150),
        (parse_toml, "a = " + "[" * DEEP),
        (parse_toml, "a = " + "[" * 150 + "]" * 150),
        (parse_toml, ".".join("a" * 5000) + " = 1"),
        (parse_toml, "[" + ".".join("a" * 5000) + "]"),
        pytest.param(parse_yaml, "[" * DEEP, marks=pytest.mark.slow),
        (parse_yaml, "[" * 150 + "]" * 150),
        (parse_yaml, "- " * 5000),
        (parse_xml, "<a>" * 150 + "</a>" * 150),
    ],
)
def test_deep_nesting(parse, text):
    assert "nested too deeply (at most 100 levels)" in refused(parse, text)


@pytest.mark.parametrize(
    ("parse", "text"),
    [
        (parse_json, "1" * 10_000),
        (parse_json, '{"a": }'),
        (parse_toml, "a = " + "1" * 10_000),
        (parse_yaml, "1" * 10_000),
        (parse_yaml, "2024-13-45"),
        (parse_yaml, "? [a]\n: 1"),
        (parse_yaml, "!!python/object/apply:os.system ['true']"),
        (parse_yaml, "a: *b"),
        (parse_yaml, "\0"),
    ],
)
def test_what_is_broken_is_said(parse, text):
    assert "broken" in refused(parse, text)


TEN = [", ".join([f"*a{k}"] * 10) for k in range(20)]
BOMB = "\n".join(["a0: &a0 [1]", *(f"a{k + 1}: &a{k + 1} [{ten}]" for k, ten in enumerate(TEN))])
MERGED = "\n".join(["a0: &a0 {x: 1}", *(f"a{k + 1}: &a{k + 1}\n  <<: [{ten}]" for k, ten in enumerate(TEN))])


@pytest.mark.parametrize("text", [BOMB, MERGED, "&a [*a]", "&a {b: *a}", "&a [[&b [*a, *b]]]"])
def test_aliases_that_stand_for_too_much(text):
    before = time.process_time()
    assert "more than 10,000,000 values, or for themselves" in refused(parse_yaml, text)
    assert time.process_time() - before < 60  # it ends


def test_aliases_of_honest_files():
    assert parse_yaml("names: &n [a, b]\npoints: [{p: *n}, {p: *n}]\n---\nsecond: 1") == {
        "names": ["a", "b"],
        "points": [{"p": ["a", "b"]}, {"p": ["a", "b"]}],
    }
    assert parse_yaml("") is None


ENTITIES = "".join(f"<!ENTITY b{k + 1} '&b{k};&b{k};'>" for k in range(30))
LAUGHS = f"<!DOCTYPE r [<!ENTITY b0 'ha'>{ENTITIES}]><r>&b30;</r>"


@pytest.mark.parametrize(
    "text", [LAUGHS, "<!DOCTYPE r [<!ENTITY x SYSTEM 'file:///etc/passwd'>]><r>&x;</r>", b"<!ENTITY"]
)
def test_entities(text):
    assert "defines entities" in refused(parse_xml, text)


@pytest.mark.parametrize(
    ("declared", "encoding"),
    [
        ('<?xml version="1.0" encoding="ISO-8859-1"?>', "iso-8859-1"),
        ("<?xml version='1.0' encoding='windows-1252'?>", "windows-1252"),
        ('<?xml version="1.0" encoding="utf-8"?>', "utf-8"),
        ('<?xml version="1.0" encoding="UTF-16"?>', "utf-16"),
        ('<?xml version="1.0"?>', "utf-8-sig"),
        ("", "utf-8"),
        ("", "iso-8859-1"),
        ('<?xml version="1.0" encoding="utf-8"?>', "iso-8859-1"),  # says what it is not
    ],
)
def test_encodings_of_xml(declared, encoding, tmp_path):
    (tmp_path / "a").write_bytes(
        f'{declared}<a b="M\N{LATIN SMALL LETTER U WITH DIAERESIS}"/>'.encode(encoding)
    )
    text = read_xml_text(tmp_path / "a")
    assert parse_xml(text).get("b") == "M\N{LATIN SMALL LETTER U WITH DIAERESIS}"
    assert parse_xml(text.encode()).get("b") == parse_xml(text).get("b")


def test_unknown_encodings_of_xml(tmp_path):
    (tmp_path / "a").write_bytes(b'<?xml version="1.0" encoding="nonsense"?><a/>')
    assert "unknown encoding 'nonsense'" in refused(read_xml_text, tmp_path / "a")
    (tmp_path / "a").write_bytes(b'<?xml version="1.0" encoding="ascii"?><a b="\xfc"/>')
    assert "not a text file in ascii" in refused(read_xml_text, tmp_path / "a")
