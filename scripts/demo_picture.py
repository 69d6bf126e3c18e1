"""The moving picture of README: demo_picture.py PAGE.html OUT.gif, of a page of `kinelm view` or `kinelm demo`.

    kinelm demo && pip install pillow && python3 scripts/demo_picture.py demo/page.html docs/demo.gif

A headless chromium (CHROMIUM=.. names another) is asked for one time after the other; pillow puts the pictures together.
"""
import base64, io, json, os, shutil, subprocess, sys, tempfile
from pathlib import Path
from PIL import Image

FROM_S, SECONDS, FPS = 1.0, 4.5, 12.5
WINDOW, PICTURE, COLOURS = (960, 540), (640, 360), 256
MOST_BYTES = 2_000_000


class Browser:
    """Chromium's debugging protocol over two pipes: messages of JSON that end in a 0."""

    def __init__(self, profile):
        names = [os.environ.get("CHROMIUM"), "chromium-headless-shell", "chromium", "chromium-browser", "google-chrome"]
        program = next((p for p in map(shutil.which, filter(None, names)) if p), None)
        if program is None:
            sys.exit("demo_picture.py: no chromium on the PATH")
        (theirs_in, self.to), (self.back, theirs_out) = os.pipe(), os.pipe()

        def pipes():  # it reads from 3 and writes to 4
            copies = [os.dup(theirs_in), os.dup(theirs_out)]
            for fd, want in zip(copies, (3, 4)):
                os.dup2(fd, want)

        flags = ["--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars",
                 "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-sync",
                 f"--user-data-dir={profile}", f"--window-size={WINDOW[0]},{WINDOW[1]}", "--remote-debugging-pipe"]
        self.process = subprocess.Popen([program, *flags], close_fds=False, preexec_fn=pipes, stderr=subprocess.DEVNULL)
        os.close(theirs_in), os.close(theirs_out)
        self.buffer, self.count, self.session = b"", 0, None

    def read(self):
        while b"\0" not in self.buffer:
            more = os.read(self.back, 1 << 20)
            if not more:
                sys.exit("demo_picture.py: the browser ended")
            self.buffer += more
        message, self.buffer = self.buffer.split(b"\0", 1)
        return json.loads(message)

    def ask(self, method, **params):
        self.count += 1
        message = {"id": self.count, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.to, json.dumps(message).encode() + b"\0")
        while (answer := self.read()).get("id") != self.count:
            pass
        if "error" in answer:
            sys.exit(f"demo_picture.py: {method}: {answer['error']['message']}")
        return answer["result"]

    def evaluate(self, expression):
        return self.ask("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)


def pictures(page):
    with tempfile.TemporaryDirectory() as profile:
        browser = Browser(profile)
        try:
            target = browser.ask("Target.createTarget", url=f"{page.resolve().as_uri()}#t={FROM_S}&pause&bare&light&still")["targetId"]
            browser.session = browser.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
            browser.evaluate("new Promise(go => document.readyState === 'complete' ? go() : addEventListener('load', go))")
            for i in range(round(SECONDS * FPS)):
                browser.evaluate(f"seek({FROM_S + i / FPS}); draw()")
                png = browser.ask("Page.captureScreenshot", format="png")["data"]
                yield Image.open(io.BytesIO(base64.b64decode(png))).convert("RGB").resize(PICTURE, Image.Resampling.LANCZOS)
        finally:
            browser.process.terminate()
            browser.process.wait()


def main(page, out):
    frames = list(pictures(Path(page)))
    # one table of colours for all, of the dancers at eight moments: most of a picture is floor
    left, top, right, bottom = (PICTURE[0] // 5, 0, PICTURE[0] * 4 // 5, PICTURE[1])
    strip = Image.new("RGB", (right - left, bottom * 8))
    for i in range(8):
        strip.paste(frames[i * len(frames) // 8].crop((left, top, right, bottom)), (0, bottom * i))
    table = strip.quantize(COLOURS)
    frames = [f.quantize(palette=table, dither=Image.Dither.NONE) for f in frames]
    frames[0].save(out, save_all=True, append_images=frames[1:], duration=round(1000 / FPS), loop=0, optimize=False)
    size = Path(out).stat().st_size
    print(f"{out}: {len(frames)} pictures, {size / 1e6:.2f} MB")
    if size > MOST_BYTES:
        sys.exit(f"more than {MOST_BYTES} bytes: fewer colours, seconds or pixels")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
