"""A strip of moments of a page of `kinelm view`: strip.py PAGE.html OUT.png [--new FROM:TO].. T T T ..

    kinelm view clip.bvh middle.bvh --out page.html
    pip install pillow && python3 scripts/strip.py page.html strip.png --new 4:6 3.8 4.4 5 5.6 6.2

Times in seconds; those in --new are marked as made anew. Each moment is cut to where its figures are.
"""
import argparse, base64, io, tempfile
from pathlib import Path

from demo_picture import Browser
from PIL import Image, ImageDraw, ImageFont

COLUMNS, TILE_HEIGHT, COLOURS, ROOM = 6, 200, 128, 24
NAMES = 64  # of a page, pixels: there the names of clips stand
NEW, GIVEN = (217, 95, 2), (110, 110, 110)


def moments(page, times):
    with tempfile.TemporaryDirectory() as profile:
        browser = Browser(profile)
        url = f"{Path(page).resolve().as_uri()}#t=0&pause&bare&light&still"
        target = browser.ask("Target.createTarget", url=url)["targetId"]
        browser.session = browser.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        browser.evaluate("new Promise(go => document.readyState === 'complete' ? go() : addEventListener('load', go))")
        for t in [times[0], *times]:  # the first look at a page may come before its first picture
            browser.evaluate(f"new Promise(go => {{ seek({t}); draw(); setTimeout(go, 200) }})")
            data = browser.ask("Page.captureScreenshot", format="png")["data"]
            yield Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")
        browser.process.terminate()
        browser.process.wait()


def figures(picture):
    """The box of what has a colour, but for the names above."""
    saturation = picture.convert("HSV").split()[1].point(lambda s: 255 if s > 60 else 0)
    saturation.paste(0, (0, 0, picture.width, NAMES))
    return saturation.getbbox()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("page")
    parser.add_argument("out")
    parser.add_argument("times", nargs="+", type=float)
    parser.add_argument("--new", action="append", default=[])
    told = parser.parse_args()
    new = [tuple(map(float, span.split(":"))) for span in told.new]
    _, *pictures = moments(told.page, told.times)
    boxes = [figures(picture) or (0, NAMES, picture.width, picture.height) for picture in pictures]
    top, bottom = max(min(box[1] for box in boxes) - ROOM, NAMES), max(box[3] for box in boxes) + ROOM
    across = max(box[2] - box[0] for box in boxes) + 2 * ROOM
    scale = TILE_HEIGHT / (bottom - top)
    width = round(across * scale)
    columns = min(COLUMNS, len(pictures))
    rows = -(-len(pictures) // columns)
    strip = Image.new("RGB", (columns * width, rows * (TILE_HEIGHT + ROOM)), "white")
    draw, font = ImageDraw.Draw(strip), ImageFont.load_default(14)
    for n, (picture, t) in enumerate(zip(pictures, told.times)):
        x, y = n % columns * width, n // columns * (TILE_HEIGHT + ROOM)
        left = (boxes[n][0] + boxes[n][2] - across) // 2
        strip.paste(picture.crop((left, top, left + across, bottom)).resize((width, TILE_HEIGHT), Image.LANCZOS), (x, y + ROOM))
        colour = NEW if any(a <= t < b for a, b in new) else GIVEN
        draw.rectangle((x, y, x + width - 2, y + 4), fill=colour)
        draw.text((x + 6, y + 6), f"{t:g} s", fill=colour, font=font)
    strip.quantize(COLOURS).save(told.out, optimize=True)


main()
