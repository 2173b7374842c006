"""The benchmark of ultra-wideband links in an apartment: what furniture explains, and its figures."""

import numpy as np

from tests.benchmarks import uwb_apartment
from tests.benchmarks.harness import Options


def test_uwb_apartment_explains_ranges_by_furniture(shared, tmp_path):
    """Held-out links: 0.39 m with furniture, where true distances leave 0.77 m; levels 3.0 dB and 5.6 dB."""
    results = uwb_apartment.main(shared / "data" / "uwb-apartment", options=Options(out=tmp_path))
    ranges, levels = (
        {
            row["row"]: row["value"]
            for row in results.rows
            if row["table"] == table and row["name"] == "root mean square"
        }
        for table in ("ranges", "levels")
    )
    assert ranges["walls and furniture"] < 0.6 * ranges["true distance"]
    assert levels["walls and furniture"] < 0.7 * levels["law of distance"]
    assert {"apartment.png", "impulse_responses.png"} <= {path.name for path in tmp_path.iterdir()}


def test_read_sheets_has_mirrors_on_long_sides(shared):
    """Two wardrobes with mirrors have two sides each of metal; without furniture there are walls only."""
    sheets, material = uwb_apartment.read_sheets(shared / "data" / "uwb-apartment", furnished=True)
    lengths_m = np.linalg.norm(sheets[:, 1] - sheets[:, 0], axis=1)
    assert material.count(3) == 4 and lengths_m[np.array(material) == 3].min() > 0.8
    assert set(uwb_apartment.read_sheets(shared / "data" / "uwb-apartment", furnished=False)[1]) == {0}
