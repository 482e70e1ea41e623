"""Where tests and CAE runs come from: read of headers and listings, kept in the tables, named where it matters."""

import hashlib
from dataclasses import replace
from pathlib import Path

import pytest

from crashfuse import cli
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.load import load_campaign
from crashfuse.campaign_folder.writer import write_campaign
from crashfuse.importing import import_source
from crashfuse.readers.isomme import read_isomme_record
from crashfuse.readers.lsdyna import read_lsdyna
from crashfuse.readers.nhtsa import read_nhtsa
from crashfuse.readers.radioss import read_radioss
from crashfuse.results.result_tables import about_table
from crashfuse.study.facts import campaign_facts
from crashfuse.testing.readers import written
from tests.conftest import SHARED, needs_shared
from tests.readers.lsdyna_files import Run
from tests.readers.radioss_files import RadiossRun

D3HSP = """ Nova full frontal
                         ls-dyna mpp.139588 s           date 11/21/2026
 |  Version : mpp s R11.1.0     |
 |  Revision: 139588            |
 |  Input file: /home/me/main.k |
"""
END = " N o r m a l    t e r m i n a t i o n     11/21/26 12:20:10\n"
SHORT = Run(end_s=0.02, step_s=1e-3)


@pytest.mark.parametrize(
    ("end", "told"), [(END, "normal"), (END.replace("N o r m a l", "E r r o r"), "error"), ("", "killed")]
)
def test_a_listing_of_ls_dyna_tells_version_deck_and_end(tmp_path: Path, end: str, told: str) -> None:
    folder = written(tmp_path, {"nodout": SHORT.nodout(), "d3hsp": (D3HSP + end).encode(), "main.k": b"*KEYWORD\n"})
    (record,) = read_lsdyna(folder)
    digest = hashlib.sha256(b"*KEYWORD\n").hexdigest()
    about = {"solver": "LS-DYNA", "version": "mpp s R11.1.0 139588", "date": "2026-11-21", "deck": "main.k"}
    assert record.about == about | {"deck_sha256": digest, "termination": told}
    written(tmp_path, {"d3hsp": (D3HSP.replace("11/21", "11/22") + end).encode()})
    (other,) = read_lsdyna(folder)
    assert "termination" not in other.about
    assert [step for step in other.steps if "listing of another run" in step]


def test_a_listing_of_radioss_tells_how_the_run_ended(tmp_path: Path) -> None:
    files = {"hc1T01": RadiossRun().binary(), "hc1_0001.out": b"** Build tag: 20260101 **\n ERROR TERMINATION\n"}
    (record,) = read_radioss(written(tmp_path / "a", files | {"hc1_0000.rad": b"#RADIOSS\n"}))
    found = (record.about["version"], record.about["termination"], record.about["deck"])
    assert found == ("20260101", "error", "hc1_0000.rad")
    files["other_0001.out"] = files.pop("hc1_0001.out")
    (record,) = read_radioss(written(tmp_path / "b", files))
    assert "termination" not in record.about


@needs_shared
def test_headers_of_tests_become_columns_that_can_be_edited(tmp_path: Path) -> None:
    real = SHARED / "real"
    import_source(real / "nhtsa_10146_camry2018", tmp_path / "c", fmt="nhtsa")
    assert read_nhtsa(real / "nhtsa_10146_camry2018")[0].about["laboratory"] == "MGA"
    assert read_isomme_record(real / "formats" / "isomme_late_sensor")[0].about["laboratory"]
    assert not cli.main(["edit", str(tmp_path / "c"), "--about", "10146", "laboratory=MGA, Wisconsin", "operator=AB"])
    header, row = (tmp_path / "c" / "tests.csv").read_text().splitlines()
    assert header.endswith('"about_date","about_sensor","about_prefilter","about_operator"')
    assert all(text in row for text in ('"MGA, Wisconsin"', '"10146"', '"2017-10-03"', "SN: PCB842", '"2800 Hz","AB"'))
    assert cli.main(["edit", str(tmp_path / "c"), "--about", "10146", "MGA"]) == 2


def test_a_run_that_did_not_end_normally_is_named_with_what_rests_on_it(campaign: Campaign, tmp_path: Path) -> None:
    run = campaign.cae.paired_run(campaign.tests[0].condition)
    assert run is not None
    ends = tuple((("about_termination", "error" if i == run else "normal"),) for i in range(len(campaign.cae)))
    tests = (replace(campaign.tests[0], about=(("about_laboratory", "Lab"),)), *campaign.tests[1:])
    write_campaign(replace(campaign, tests=tests, cae=replace(campaign.cae, about=ends)), tmp_path / "c")
    again = load_campaign(tmp_path / "c")
    assert [test.condition for test in again.tests] == [test.condition for test in campaign.tests]
    (fact,) = (fact for fact in campaign_facts(again) if fact.code == "cae.ended_otherwise")
    assert fact.values == {"runs": {campaign.cae.ids[run]: "error"}, "paired_tests": [campaign.tests[0].id]}
    table = about_table(again).texts()
    assert table["Laboratory"].tolist() == ["Lab", "–"]
    assert table["Termination"].iloc[1] == f"normal ({len(campaign.cae) - 1}), error (1)"
