"""Tables of documents."""

import re

from ocptip.pictures.document import grid


def test_columns_of_short_texts_are_as_wide_as_these_beside_long_ones():
    titles = ["payload", "normal force", "stable", *["GT"] * 5, "where"]
    row = ["+0.5 kg", "12.4 N", "yes", *["0.441"] * 5, "downhill at 300 deg, push at 301 deg, " * 3]
    shares = [float(share) for share in re.findall("data-width='(.*?)%'", grid(titles, [row]))]
    line = (len("payload") + 2) / shares[0]  # characters of a percent
    assert abs(sum(shares) - 100) < 0.5
    assert 80 < 100 * line < 120  # what fits on a line of A4 in 9 points
    for share, text in zip(shares[1:-1], ("12.4 N", "stable", *["0.441"] * 5), strict=True):
        assert share * line >= len(text) + 1.9
    assert shares[-1] * line > 30
