"""The campaign of other plants: cut off anywhere it goes on, and its table is what was flown."""

import csv
import json

import pytest
from house import script

pytest.importorskip("mujoco")


@pytest.fixture
def campaign(tmp_path, monkeypatch):
    with script("benchmarks", "plants") as plants:
        monkeypatch.setattr(plants, "FLIGHTS", tmp_path)
        monkeypatch.setattr(plants, "SECONDS", 2.0)
        yield plants


def test_what_was_flown_is_not_flown_again_and_the_rest_is_the_same(campaign, tmp_path):
    cell = campaign.Cell("mujoco", "scenes", "off")
    cell.fly(2)
    before = cell.rows()
    cell.fly(3)
    assert cell.rows()[:2] == before and [row["flight"] for row in cell.rows()] == ["0", "1", "2"]
    cell.file.unlink()
    cell.fly(1)
    assert {**cell.rows()[0], "seconds": ""} == {**before[0], "seconds": ""}
    cell.file.write_text(cell.file.read_text().replace("rotor_lag", "another_lag"))
    with pytest.raises(ValueError, match="must be of flights that were told"):
        cell.fly(2)


def test_the_table_counts_what_was_flown(campaign, tmp_path):
    for arm in campaign.ARMS:
        campaign.Cell("mujoco", "sphere", arm).fly(2)
    out = tmp_path / "table" / "plants.csv"
    campaign.write_table(out)
    off, _, told = csv.DictReader(out.read_text(encoding="utf-8").splitlines())
    assert (off["flights"], off["violated"], told["violated"]) == ("2", "2.0", "0.0")
    assert told["certified"] == "1.0" and told["surprised_flights"] == "0.0"
    assert float(told["greatest_snap"]) < json.loads(told["told"])["snap"]
    assert float(told["least_clearance"]) > 0.0
    line = campaign.table(out).splitlines()[-1]
    assert line.startswith("| mujoco | sphere | 2 of 2 | ") and "| 0 of 2 [≤ 77.64 %] |" in line
