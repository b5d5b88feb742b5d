for (const pair of document.querySelectorAll(".compare")) {
  const slider = document.createElement("input");
  Object.assign(slider, { type: "range", min: 0, max: 100, step: 0.1, value: 50, ariaLabel: "Share of the first picture" });
  const cut = (percent) => {
    slider.value = percent;
    pair.style.setProperty("--cut", `${slider.value}%`);
  };
  slider.addEventListener("input", () => cut(slider.value));
  pair.firstElementChild.addEventListener("pointermove", (event) => {
    const box = pair.firstElementChild.getBoundingClientRect();
    cut((100 * (event.clientX - box.left)) / box.width);
  });
  pair.append(slider);
  pair.classList.add("live");
}
