"""The page of `locvol report` in a real browser: headless Chromium, from file://, with WebGL in
software. Usage: page_browser_test.py LOCVOL. Exit code 77: there is no browser to test with."""

import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

import browser

LOCVOL = sys.argv.pop(1)
NO_BROWSER = 77


BOX = """v 0 0 0\nv 3 0 0\nv 0 2 0\nv 3 2 0\nv 0 0 1\nv 3 0 1\nv 0 2 1\nv 3 2 1
g below\nf 1 3 4 2\ng above <b>\nf 5 6 8 7\ng front\nf 1 2 6 5\ng back\nf 3 7 8 4
g inlet\nf 1 5 7 3\ng outlet\nf 2 4 8 6
"""

# Two boxes that touch in a face.
PAIR = """v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 0 0 1\nv 1 0 1\nv 0 1 1\nv 1 1 1
v 3 0 0\nv 3 1 0\nv 3 0 1\nv 3 1 1
g rotor\nf 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8\nf 2 8 6
g <stator>\nf 2 4 10 9\nf 6 11 12 8\nf 2 9 11 6\nf 4 8 12 10\nf 9 10 12 11\nf 2 8 4\nf 2 6 8
"""


def locvol(*arguments):
    subprocess.run([LOCVOL, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


class PageTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        cls.dir = pathlib.Path(cls.scratch.name)
        surface, store = cls.dir / "ball.stl", cls.dir / "store"
        locvol("generate", "sphere", "-o", surface, "--triangles", "3k")
        locvol("mesh", surface, "-o", cls.dir / "ball.vtu", "--size", "4%", "--leaf-capacity",
               "800", "--store", store, "--quiet")
        locvol("mesh", surface, "-o", cls.dir / "graded.vtu", "--size", "4%", "--growth", "0.3",
               "--store", cls.dir / "graded", "--quiet")
        locvol("report", cls.dir / "graded", "-o", cls.dir / "graded.html")
        (cls.dir / "box.obj").write_text(BOX, encoding="utf-8")
        locvol("mesh", cls.dir / "box.obj", "-o", cls.dir / "box.vtu", "--size", "10%",
               "--store", cls.dir / "box", "--quiet")
        locvol("report", cls.dir / "box", "-o", cls.dir / "sheets.html")
        locvol("report", cls.dir / "box", "-o", cls.dir / "sheets-of-planes.html", "--cells", "1500")
        (cls.dir / "pair.obj").write_text(PAIR, encoding="utf-8")
        locvol("mesh", cls.dir / "pair.obj", "-o", cls.dir / "pair.vtu", "--size", "20%",
               "--bodies", "--store", cls.dir / "pair", "--quiet")
        locvol("report", cls.dir / "pair", "-o", cls.dir / "bodies.html")
        locvol("report", cls.dir / "pair", "-o", cls.dir / "bodies-of-planes.html", "--cells",
               "600")
        locvol("report", store, "-o", cls.dir / "whole.html")
        locvol("report", store, "-o", cls.dir / "planes.html", "--cells", "15000")
        cls.browser = browser.Browser(640, 480).__enter__()

    @classmethod
    def tearDownClass(cls):
        cls.browser.__exit__()
        cls.scratch.cleanup()

    def open(self, name):
        self.browser.open((self.dir / name).as_uri())
        self.assertTrue(self.browser.run("return locvolReport.ready"))

    def picture(self, script=""):
        return self.browser.run(f"{script}; return locvolReport.picture()")

    def colors(self):
        """How many colors the canvas shows, in steps of 16."""
        return self.browser.run("""
            locvolReport.picture();
            const from = document.getElementById('canvas'), to = document.createElement('canvas');
            to.width = to.height = 200;
            const ink = to.getContext('2d');
            ink.drawImage(from, 0, 0, 200, 200);
            const colors = new Set(), data = ink.getImageData(0, 0, 200, 200).data;
            for (let i = 0; i < data.length; i += 4)
              colors.add([data[i] >> 4, data[i + 1] >> 4, data[i + 2] >> 4].join());
            return colors.size""")

    def check_view(self):
        self.assertGreater(self.colors(), 20)
        seen = [self.picture()]
        for script in ("locvolReport.turn(0.7)", "locvolReport.set({offset: 0.2})",
                       "locvolReport.set({axis: 1})", "locvolReport.set({axis: 3})",
                       "locvolReport.set({isFlipped: true})",
                       "locvolReport.set({color: 'level'})", "locvolReport.set({color: 'plain'})",
                       "locvolReport.set({boxes: true})", "locvolReport.set({up: 'y'})",
                       "locvolReport.set({isCut: false})"):
            seen.append(self.picture(script))
            self.assertNotEqual(seen[-1], seen[-2], script)
        self.assertEqual(self.picture("locvolReport.reset()"), seen[0])

    def check_quiet(self):
        """No message in the console, and nothing asked for but the page itself."""
        self.assertEqual([entry for entry in self.browser.log("browser")
                          if entry["level"] in ("SEVERE", "WARNING")], [])
        asked = [entry["message"] for entry in self.browser.log("performance")
                 if '"Network.requestWillBeSent"' in entry["message"]]
        self.assertFalse([m for m in asked if "http://" in m or "https://" in m])

    def test_shows_the_whole_mesh(self):
        self.open("whole.html")
        self.check_view()
        counts = self.browser.run("return locvolReport.triangles()")
        self.assertGreater(counts["shell"], 1000)
        for mode in ("locvolReport.set({isFlat: false})", "locvolReport.set({isFlat: true})"):
            self.picture(mode)
            self.assertGreater(self.browser.run("return locvolReport.triangles().cut"), 300)
        angle = self.picture("locvolReport.set({color: 'angle'})")
        self.assertNotEqual(angle, self.picture("locvolReport.set({color: 'ratio'})"))
        self.assertIn("60°", self.browser.run(
            "locvolReport.set({color: 'angle'}); return document.getElementById('legend').innerText"))
        self.check_quiet()

    def test_colors_cells_by_size_where_sizes_vary(self):
        self.open("graded.html")
        plain = self.picture("locvolReport.set({color: 'plain'})")
        self.assertNotEqual(plain, self.picture("locvolReport.set({color: 'radius'})"))
        self.assertIn("circumradius", self.browser.run(
            "return document.getElementById('legend').innerText"))
        self.check_quiet()

    def test_colors_facets_by_sheet_and_names_them(self):
        for page in ("sheets.html", "sheets-of-planes.html"):
            with self.subTest(page):
                self.open(page)
                plain = self.picture("locvolReport.set({color: 'plain', isCut: false})")
                self.assertNotEqual(plain, self.picture("locvolReport.set({color: 'sheet'})"))
                legend = self.browser.run("return document.getElementById('legend').innerText")
                for name in ("below", "above <b>", "front", "back", "inlet", "outlet"):
                    self.assertIn(name, legend)
                # The pointer alone asks; no click.
                x, y = map(int, self.browser.run("""
                    const box = document.getElementById('canvas').getBoundingClientRect();
                    return [box.x + box.width / 2, box.y + box.height / 2]"""))
                move = {"type": "pointerMove", "duration": 50, "origin": "viewport"}
                self.browser.act([{"type": "pointer", "id": "mouse",
                                   "parameters": {"pointerType": "mouse"},
                                   "actions": [{**move, "x": x, "y": y},
                                               {**move, "x": x + 3, "y": y}]}])
                self.browser.run("locvolReport.picture()")
                self.assertRegex(
                    self.browser.run("return document.getElementById('picked').innerText"),
                    r"^sheet \d, (below|above <b>|front|back|inlet|outlet): area \d")
                self.assertRegex(self.browser.run("return document.body.innerText"),
                                 r"5 inlet\s+\d+ facets, area .*plane")
                self.check_quiet()

    def test_hides_bodies(self):
        for page in "bodies.html", "bodies-of-planes.html":
            with self.subTest(page):
                self.open(page)
                shown = self.browser.run("return document.getElementById('bodies').innerText")
                self.assertEqual(shown.split(), ["rotor", "<stator>"])
                run = self.browser.run
                count = "return locvolReport.triangles()"
                whole, picture = run(count), self.picture()
                box = "document.querySelectorAll('#bodies input')[{}].click()"
                run(box.format(1))
                self.assertNotEqual(self.picture(), picture)
                rotor = run(count)
                run(box.format(0) + ";" + box.format(1))
                stator = run(count)
                # What lies between the two is of each alone, and not seen of both.
                self.assertGreater(rotor["shell"] + stator["shell"], whole["shell"])
                self.assertEqual((rotor["shell"] + stator["shell"] - whole["shell"]) % 2, 0)
                self.assertGreater(stator["shell"], rotor["shell"] if page == "bodies.html" else 0)
                self.assertLessEqual(rotor["cut"] + stator["cut"], 2 * whole["cut"])
                run("document.getElementById('noBodies').click()")
                self.assertEqual(run(count)["shell"], 0)
                run("document.getElementById('allBodies').click()")
                self.assertEqual(run(count), whole)
                self.check_quiet()
        self.open("bodies.html")
        self.picture("locvolReport.set({color: 'body'})")
        self.assertIn("by body", self.browser.run("return document.body.innerText"))

    def texts_along(self, fraction):
        """What the pointer is told on its way across the view, at this part of its height."""
        x, y, width = self.browser.run(f"""
            const box = document.getElementById('canvas').getBoundingClientRect();
            return [box.x, box.y + box.height * {fraction}, box.width]""")
        texts = set()
        for step in range(60):
            self.browser.run(f"""
                document.getElementById('canvas').dispatchEvent(new PointerEvent('pointermove', {{
                    clientX: {x + width * step / 60}, clientY: {y}, bubbles: true}}));
                return new Promise(done => requestAnimationFrame(
                    () => requestAnimationFrame(() => done(true))));""")
            texts.add(self.browser.run("return document.getElementById('picked').innerText"))
        return texts

    def test_draws_creases_and_names_the_one_under_the_pointer(self):
        for page in ("sheets.html", "sheets-of-planes.html"):
            with self.subTest(page):
                self.open(page)
                shown = self.picture("locvolReport.set({color: 'plain', isCut: false})")
                self.assertNotEqual(shown, self.picture("locvolReport.set({creases: false})"))
                self.assertEqual({text for text in self.texts_along(0.5) if "crease" in text}, set())
                self.picture("locvolReport.set({creases: true})")
                texts = [text for text in self.texts_along(0.5) if text.startswith("crease")]
                self.assertGreater(len(texts), 0)
                for text in texts:
                    self.assertRegex(text, r"^crease \d+, [a-z <>]+/[a-z <>]+: length [123]\.0000")
                self.check_quiet()
        self.open("whole.html")  # a ball, which has none
        self.assertEqual(self.browser.run(
            "return document.getElementById('creases').parentElement.style.display"), "none")

    def test_shows_planes_of_a_large_mesh(self):
        self.open("planes.html")
        self.assertGreater(self.browser.run("return locvolReport.triangles().cut"), 100)
        self.check_view()
        # Away from the stored planes the section is filled, in the colors of the leaves.
        self.picture("locvolReport.set({axis: 3, isCut: true})")
        self.assertEqual(self.browser.run("return locvolReport.triangles().cut"), 0)
        filled = self.picture("locvolReport.set({color: 'leaf'})")
        self.assertNotEqual(filled, self.picture("locvolReport.set({color: 'plain'})"))
        self.assertIn("filled by leaf", self.browser.run(
            "return document.getElementById('where').textContent"))
        self.check_quiet()

    def test_fits_screens(self):
        self.open("whole.html")
        self.addCleanup(self.browser.resize, 640, 480)
        for width in (320, 390, 700, 1000, 1920):
            self.browser.resize(width, 800)
            inner, page, table = self.browser.run("""
                const right = element => element.getBoundingClientRect().right;
                return [innerWidth, document.documentElement.scrollWidth,
                        Math.max(...[...document.querySelectorAll('table')].map(right))]""")
            self.assertEqual(inner, width)
            self.assertLessEqual(page, width)
            self.assertLessEqual(table, width)
            self.assertGreater(self.colors(), 20)
        self.check_quiet()

    def check_up(self, press):
        """Which axes stand upright in the drawn cross of axes: z, and the others at a key."""
        upright = """
            return [...document.querySelectorAll('#axes text')].filter(text =>
                Math.abs(text.getAttribute('x')) < 0.1 && text.getAttribute('y') < 0).map(
                text => text.textContent).join()"""
        self.assertEqual(self.browser.run(upright), "z")
        seen = [self.picture()]
        for axis in "xy":
            seen.append(press("u"))
            self.assertEqual(self.browser.run(upright), axis)
            self.assertEqual(self.browser.run("return document.getElementById('up').value"), axis)
            self.assertNotEqual(seen[-1], seen[-2])
        self.assertEqual(press("u"), seen[0])

    def test_obeys_mouse_and_keys(self):
        self.open("whole.html")
        before = self.picture()
        canvas = self.browser.run("""
            const box = document.getElementById('canvas').getBoundingClientRect();
            return [box.x + box.width / 2, box.y + box.height / 2]""")
        x, y = map(int, canvas)
        move = {"type": "pointerMove", "duration": 50, "origin": "viewport"}
        self.browser.act([{"type": "pointer", "id": "mouse", "parameters": {"pointerType": "mouse"},
                           "actions": [{**move, "x": x, "y": y},
                                       {"type": "pointerDown", "button": 0},
                                       {**move, "x": x + 120, "y": y + 40},
                                       {"type": "pointerUp", "button": 0}]}])
        turned = self.picture()
        self.assertNotEqual(turned, before)

        def press(key):
            self.browser.act([{"type": "key", "id": "keys", "actions": [
                {"type": "keyDown", "value": key}, {"type": "keyUp", "value": key}]}])
            return self.picture()
        self.browser.act([{"type": "pointer", "id": "mouse", "parameters": {"pointerType": "mouse"},
                           "actions": [{**move, "x": x, "y": y}, {"type": "pointerDown", "button": 0},
                                       {"type": "pointerUp", "button": 0}]}])
        picked = self.browser.run("return document.getElementById('picked').innerText")
        self.assertRegex(picked, r"leaf [0-9a-f]{16}, level \d: .*\ncell: smallest angle \d+")
        self.assertNotEqual(press("c"), turned)
        self.assertNotEqual(press("b"), turned)
        self.assertEqual(press("r"), before)
        self.check_up(press)
        self.browser.run("""
            const slider = document.getElementById('offset');
            slider.value = 0.8;
            slider.dispatchEvent(new Event('input'))""")
        self.assertNotEqual(self.picture(), before)
        self.check_quiet()


if __name__ == "__main__":
    if browser.find() is None:
        print("skipped: needs chromium and chromedriver. To run it: "
              "tools/setup.sh chromium chromium-driver && tools/test.sh -R page_browser")
        sys.exit(NO_BROWSER)
    os.environ.setdefault("HOME", tempfile.gettempdir())
    unittest.main(verbosity=2)
