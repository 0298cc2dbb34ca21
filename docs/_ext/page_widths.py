"""What is wider than its page in a window of 500 pixels, measured by a headless Chromium where there is one."""

import functools
import html
import http.server
import json
import re
import shutil
import subprocess
import tempfile
import threading
from pathlib import Path

WIDTH = 500
PATIENCE = 600  # seconds
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
# Every page in a frame of its own, one after the other; what scrolls or is cut off by an element around it is no fault.
MEASURE = """<!doctype html><body><iframe id="f" style="border:0;width:%dpx;height:900px"></iframe><pre id="out"></pre>
<script>
const pages = %s, frame = document.getElementById("f"), found = [];
const kept = (node, root) => {
  for (let up = node.parentElement; up && up !== root; up = up.parentElement)
    if (getComputedStyle(up).overflowX !== "visible") return true;
  return false;
};
const measure = page => new Promise(done => {
  frame.onload = () => setTimeout(() => {
    const inside = frame.contentDocument, root = inside.querySelector("article") || inside.body;
    for (const node of root.querySelectorAll("*")) {
      const box = node.getBoundingClientRect(), parent = node.parentElement.getBoundingClientRect();
      if (box.width > 1 && box.right > %d + 1 && parent.right <= %d + 1 && !kept(node, root))
        found.push([page, node.tagName + "." + (node.getAttribute("class") || ""), Math.round(box.right),
          (node.textContent || "").trim().slice(0, 50)]);
    }
    done();
  }, 50);
  frame.src = page;
});
(async () => {
  for (const page of pages) await measure(page);
  document.getElementById("out").textContent = JSON.stringify(found);
  document.title = "done";
})();
</script></body>"""


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:
        """Say nothing of requests."""


def too_wide(site: Path) -> list[str] | None:
    """Elements that reach over the edge of a narrow window, with their pages; None where there is no browser.

    Args:
        site: Folder of the built pages.
    """
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if browser is None:
        return None
    paths = [path.relative_to(site) for path in sorted(site.rglob("*.html"))]
    pages = [str(path) for path in paths if path.parts[0] not in ("_static", "_sources", "_modules")]
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_Quiet, directory=str(site)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    measuring = site / "_widths.html"
    measuring.write_text(MEASURE % (WIDTH, json.dumps(pages), WIDTH, WIDTH), encoding="utf-8")
    try:
        with tempfile.TemporaryDirectory() as profile:
            done = subprocess.run(
                [
                    browser, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={profile}",
                    "--window-size=1200,1000", f"--virtual-time-budget={PATIENCE * 1000}", "--dump-dom",
                    f"http://127.0.0.1:{server.server_address[1]}/{measuring.name}",
                ],
                capture_output=True, text=True, timeout=PATIENCE, check=True,
            )  # fmt: skip
    finally:
        measuring.unlink()
        server.shutdown()
        server.server_close()
    shown = re.search(r'<pre id="out">(.*?)</pre>', done.stdout, re.DOTALL)
    if "<title>done</title>" not in done.stdout or shown is None:
        raise RuntimeError("the browser did not measure all pages")
    return [
        f"{page}: {element} reaches to pixel {right} of {WIDTH}: {text}"
        for page, element, right, text in json.loads(html.unescape(shown[1]))
    ]
