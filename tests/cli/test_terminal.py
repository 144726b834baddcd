"""Progress without a terminal: a line every few seconds, on the stream that is given."""

import io
import time

from ocptip.cli.layout import headline_of, headlines
from ocptip.cli.terminal import Progress, lines_while


class Terminal(io.StringIO):
    def isatty(self):
        return True


def wait_for(stream, text):
    end = time.monotonic() + 20
    while text not in stream.getvalue() and time.monotonic() < end:
        time.sleep(0.01)
    return text in stream.getvalue()


def test_lines_say_what_is_computed_while_it_is():
    stream = io.StringIO()
    with lines_while(stream, "ocptip check", every=0.02), Progress(stream, "reading ...") as progress:
        assert wait_for(stream, "ocptip check: reading ... (0 s)\n")
        progress(30, 120, None)
        assert wait_for(stream, "30/120 starts (0 s)\n")
        progress.stage("proving ...")
        assert wait_for(stream, "ocptip check: proving ... (")
    before = stream.getvalue()
    time.sleep(0.1)
    assert stream.getvalue() == before
    assert "\r" not in before


def test_nothing_is_written_where_nothing_is_shown_and_on_terminals():
    stream, terminal = io.StringIO(), Terminal()
    with lines_while(stream, "ocptip view", every=0.01), lines_while(terminal, "ocptip view", every=0.01):
        time.sleep(0.1)
    assert stream.getvalue() == ""
    assert terminal.getvalue() == ""


def test_headlines_keep_80_columns():
    head = "cart   LOAD CHART, at rest, within 'workshop' uncertainty (default), in place of the task's 5 kg."
    first, second = headlines(head)
    assert len(first) <= 80
    assert second.startswith("        ")
    assert f"{first} {second.strip()}" == head
    table = "              nominal  worst case"
    for below in ("Motion  1.5 s", "", table, "margin  3"):
        assert headline_of("\n".join([first, second, below])) == head
        assert headline_of("\n".join(["PROVED", below])) == "PROVED"
