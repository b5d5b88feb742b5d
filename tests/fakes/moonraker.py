"""A stub of Moonraker, and of a machine with Klipper behind it. It prints its port. What the machine is told goes to the file of
the variable EVENTS; the variable HOMED has its homed axes."""

import http.server
import json
import math
import os
import re
import time
import urllib.parse

PLACE = [120.0, 80.0]


class Handler(http.server.BaseHTTPRequestHandler):
    def answer(self, result, status=200):
        body = json.dumps({"result": result} if status == 200 else {"error": {"code": status, "message": result}}).encode()
        self.send_response(status)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def do_GET(self):
        if self.path == "/printer/info":
            self.answer({"state": "ready", "state_message": "Printer is ready"})
        elif self.path == "/printer/objects/query?toolhead&print_stats":
            toolhead = {"position": [*PLACE, 5.0, 0.0], "homed_axes": os.environ.get("HOMED", "xyz")}
            self.answer({"eventtime": 1.0, "status": {"toolhead": toolhead, "print_stats": {"state": "standby"}}})
        else:
            self.answer("Not Found", 404)

    def do_POST(self):
        url = urllib.parse.urlsplit(self.path)
        script = urllib.parse.parse_qs(url.query).get("script", [""])[0]
        found = re.fullmatch(r"G90\nG1 X([-\d.]+) Y([-\d.]+) F([\d.]+)\nM400", script)
        if url.path != "/printer/gcode/script" or not found:
            return self.answer(f"unexpected {self.path}", 400)
        x, y, speed = map(float, found.groups())
        if y < 0:
            return self.answer("Move out of range", 400)
        time.sleep(60 * math.dist(PLACE, (x, y)) / speed)
        PLACE[:] = x, y
        with open(os.environ["EVENTS"], "a") as file:
            print(f"to {x} {y}", file=file)
        self.answer("ok")

    def log_message(self, *_):
        pass


server = http.server.HTTPServer(("127.0.0.1", 0), Handler)
print(server.server_address[1], flush=True)
server.serve_forever()
