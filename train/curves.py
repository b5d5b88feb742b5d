"""Draws the log of a training: `python curves.py LOG.jsonl OUT.svg`."""

import json
import sys

WIDTH, HEIGHT, MARGIN = 720, 240, 40


def curve(points, limits, color, name, row):
    (x0, x1), (y0, y1) = limits
    place = lambda x, y: (MARGIN + (x - x0) / (x1 - x0 or 1) * WIDTH, MARGIN + (1 - (y - y0) / (y1 - y0 or 1)) * HEIGHT)
    path = " ".join("%.1f,%.1f" % place(x, y) for x, y in points)
    last = f"{name}: {points[-1][1]:.3f}"
    text = f'<text x="{MARGIN + WIDTH - 8}" y="{MARGIN + 16 * row}" text-anchor="end" fill="{color}">{last}</text>'
    return f'<polyline points="{path}" fill="none" stroke="{color}" stroke-width="1.5"/>' + text


def main():
    log, target = sys.argv[1:]
    lines = [json.loads(line) for line in open(log)]
    curves = [("loss", [(line["step"], line["loss"]) for line in lines if "loss" in line])]
    held_back = [line for line in lines if "held_back" in line]
    for name in held_back[-1]["held_back"] if held_back else []:
        curves.append((f"mean error, {name}", [(line["step"], line["held_back"][name][1]) for line in held_back if name in line["held_back"]]))
    points = [point for _, found in curves for point in found]
    top = 1.2 * max(found[len(found) // 3][1] for _, found in curves)
    limits = (0, max(x for x, _ in points)), (0, top)
    colors = ["#888", "#c33", "#36c", "#393", "#a3a"]
    drawn = [
        curve([(x, min(y, top)) for x, y in found], limits, colors[i % len(colors)], name, i + 1)
        for i, (name, found) in enumerate(curves)
    ]
    axes = f'<rect x="{MARGIN}" y="{MARGIN}" width="{WIDTH}" height="{HEIGHT}" fill="none" stroke="#ccc"/>'
    labels = f'<text x="4" y="{MARGIN + 12}">{top:.2f}</text><text x="{MARGIN + WIDTH}" y="{MARGIN + HEIGHT + 16}" text-anchor="end">'
    labels += f"{limits[0][1]} steps</text>"
    size = f'width="{WIDTH + 2 * MARGIN}" height="{HEIGHT + 2 * MARGIN}"'
    style = "<style>text { font: 12px sans-serif }</style>"
    with open(target, "w") as file:
        file.write(f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{style}{axes}{labels}{"".join(drawn)}</svg>\n')


if __name__ == "__main__":
    main()
