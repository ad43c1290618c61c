"""The page in a real browser: no error on the console, filters change the points, every link resolves.

Chromium loads a copy of the page with a script that works the controls and leaves what it saw in the document.
"""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess

import pytest
from made_up_report import without_scripts

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium: apt-get install chromium"),
]
LISTEN = """<script>
window.seen = {errors: []};
for (const kind of ["error", "warn"]) {
  const before = console[kind];
  console[kind] = (...words) => { seen.errors.push(words.join(" ")); before.apply(console, words); };
}
addEventListener("error", (event) => seen.errors.push(event.message));
addEventListener("unhandledrejection", (event) => seen.errors.push(String(event.reason)));
</script>"""
WORK = """<script>
const points = (place) => place.querySelectorAll(".mark-symbol.role-mark path").length;
const settle = () => new Promise((done) => setTimeout(done, 300));
async function work() {
  await settle(); await settle();
  seen.width = document.documentElement.clientWidth;
  seen.scroll = document.documentElement.scrollWidth;
  seen.hidden = [...document.querySelectorAll(".live > figure")]
    .every((one) => getComputedStyle(one).display == "none");
  seen.ink = getComputedStyle(document.querySelector("h1")).color;
  seen.dead = [...document.querySelectorAll("a[href]")].map((one) => one.getAttribute("href"))
    .filter((link) => !link.startsWith("#") || !document.getElementById(link.slice(1)));
  seen.charts = [];
  for (const place of document.querySelectorAll(".chart")) {
    const chart = {all: points(place), tips: 0, filters: {}};
    const point = place.querySelector(".mark-symbol.role-mark path");
    chart.label = point.getAttribute("aria-label");
    for (const select of place.querySelectorAll("select")) {
      const before = select.value, counts = {};
      for (const option of select.options) {
        select.value = option.value;
        select.dispatchEvent(new Event("change", {bubbles: true}));
        await settle();
        counts[option.value] = [points(place), place.parentElement.querySelector("output").textContent];
      }
      select.value = before;
      select.dispatchEvent(new Event("change", {bubbles: true}));
      await settle();
      chart.filters[select.name] = counts;
    }
    seen.charts.push(chart);
  }
}
function leave() {
  const place = document.createElement("pre");
  place.id = "seen";
  place.textContent = JSON.stringify(seen);
  document.body.append(place);
}
addEventListener("load", () => work().catch((error) => seen.errors.push(String(error))).finally(leave));
</script>"""


def browse(page: str, folder, *options: str) -> dict:
    """What the script above saw of `page`."""
    file = folder / "page.html"
    file.write_text(page.replace("<head>", "<head>" + LISTEN, 1))
    text = file.read_text()
    end = text.rindex("</body>")
    file.write_text(text[:end] + WORK + text[end:])
    command = [
        CHROMIUM,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--virtual-time-budget=60000",
        f"--user-data-dir={folder / 'profile'}",
        *options,
        "--dump-dom",
        file.as_uri(),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=150, check=False)
    found = re.search(r'<pre id="seen">(.*?)</pre>', done.stdout, re.DOTALL)
    assert found, f"the page's script did not end: {done.stderr[-600:]}"
    return json.loads(html.unescape(found[1]))


@pytest.fixture(scope="module")
def seen(drawn, tmp_path_factory):
    return browse((drawn / "report.html").read_text(), tmp_path_factory.mktemp("browser"))


def test_nothing_is_said_on_the_console(seen):
    assert seen["errors"] == []


def test_every_link_resolves(seen):
    assert seen["dead"] == []


def test_charts_replace_the_printed_figures_and_filters_change_their_points(seen):
    assert len(seen["charts"]) == 3 and seen["hidden"]
    for chart in seen["charts"]:
        assert {"choose_scene", "choose_tracer", "choose_intersector"} <= set(chart["filters"])
        scenes = chart["filters"]["choose_scene"]
        parts = {name: count for name, (count, _) in scenes.items() if name != "all"}
        assert len(parts) > 1 and all(parts.values())
        assert sum(parts.values()) == scenes["all"][0] > chart["all"] > 0
        tracers = chart["filters"]["choose_tracer"]
        assert 0 < tracers["deferred"][0] < tracers["all"][0]
        for count, text in scenes.values():
            assert text == f"{count} point" + ("s" if count != 1 else "")


def test_points_name_their_record(seen):
    for chart in seen["charts"]:
        assert re.search(r"record: [0-9a-f]{16}", chart["label"]), chart["label"]


def test_a_fault_of_a_script_and_a_dead_link_are_seen(drawn, tmp_path):
    page = (drawn / "report.html").read_text().replace("</main>", '<a href="#nowhere">x</a></main>')
    found = browse(page.replace("vegaEmbed(place", "vegaEmbedded(place"), tmp_path)
    assert found["errors"] and found["dead"] == ["#nowhere"]


def test_the_page_fits_a_narrow_window_and_follows_the_dark(drawn, tmp_path):
    narrow = browse(
        (drawn / "report.html").read_text(),
        tmp_path,
        "--window-size=500,900",
        "--blink-settings=preferredColorScheme=0",
    )
    assert narrow["scroll"] <= narrow["width"] <= 500
    assert narrow["ink"] == "rgb(230, 232, 235)"


def test_without_scripts_every_figure_is_there(drawn):
    page = without_scripts((drawn / "report.html").read_text())
    assert page.count('class="explore" hidden') == 3
    assert page.count('<div class="wide">') == len(list((drawn / "figures").glob("*.svg")))
