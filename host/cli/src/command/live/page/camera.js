// The camera and the sets that it has taken.

const byId = (id) => document.getElementById(id);

export class CameraPanel {
  constructor(say) {
    this.best = 0;
    byId("take").addEventListener("click", () => {
      // Until the server answers: a second click would take a second set.
      byId("take").disabled = true;
      say("take");
    });
    byId("stop").addEventListener("click", () => say("stop"));
    byId("history").addEventListener("change", (event) => say({ open: event.target.value }));
    byId("focus-reset").addEventListener("click", () => {
      this.best = 0;
    });
  }

  handlers() {
    return {
      preview: (contents) => this.takePreview(contents),
      capture: (contents) => this.takeCapture(contents),
      history: (contents) => this.takeHistory(contents),
    };
  }

  takePreview({ failure, picture, width, height, meters }) {
    byId("camera-failure").hidden = !failure;
    if (failure) {
      byId("camera-failure").textContent = failure;
      return;
    }
    Object.assign(byId("preview"), { src: picture, width, height, hidden: false });
    byId("preview-state").hidden = true;
    byId("meters").hidden = false;
    const { focus, mean, white, black, histogram } = meters;
    this.best = Math.max(this.best, focus);
    byId("focus-value").textContent = `${focus.toFixed(1)}, best ${this.best.toFixed(1)}`;
    byId("focus").value = this.best > 0 ? focus / this.best : 0;
    byId("mean").textContent = mean.toFixed(0);
    byId("white").textContent = `${(100 * white).toFixed(1)} %`;
    byId("white").classList.toggle("alarming", white > 0.01);
    byId("black").textContent = `${(100 * black).toFixed(1)} %`;
    const most = Math.max(...histogram, 1);
    const bin = 256 / histogram.length;
    const tops = histogram.map((count, i) => `L${i * bin} ${64 - (62 * count) / most}h${bin}`).join("");
    byId("histogram-line").setAttribute("d", `M0 64${tops}L256 64Z`);
  }

  takeCapture({ failure, step, done, total, is_running }) {
    byId("take").disabled = is_running;
    byId("stop").disabled = !is_running;
    byId("capture-progress").hidden = !is_running;
    if (is_running) Object.assign(byId("capture-progress"), { max: Math.max(total, 1), value: done });
    byId("capture-state").textContent = step ?? "";
    byId("camera-failure").hidden = !failure;
    byId("camera-failure").textContent = failure ?? "";
  }

  takeHistory({ folders, current }) {
    byId("history").disabled = !folders.length;
    byId("history").replaceChildren(...folders.map((name) => new Option(name, name)));
    if (current) byId("history").value = current;
    if (!folders.length) document.getElementById("state").textContent = "Take a set to match it";
  }
}
