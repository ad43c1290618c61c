// Draws each chart of the page where scripts run; what it replaces is the printed figure, which stays without them.
for (const holder of document.querySelectorAll(".explore")) {
  const specification = JSON.parse(holder.querySelector("script").textContent);
  const place = holder.querySelector(".chart");
  const options = { renderer: "svg", actions: false, mode: "vega-lite", tooltip: { theme: "page" } };
  holder.hidden = false; // a hidden element has no width to draw for
  vegaEmbed(place, specification, options)
    .then((drawn) => {
      place.view = drawn.view;
      holder.parentElement.classList.add("live");
      const count = holder.querySelector("output");
      const say = () => {
        const shown = place.querySelectorAll(".mark-symbol.role-mark path").length;
        count.textContent = `${shown} ${shown === 1 ? "point" : "points"}`;
      };
      for (const name of specification.params.map((one) => one.name)) {
        drawn.view.addSignalListener(name, () => drawn.view.runAsync().then(say));
      }
      say();
    })
    .catch((error) => {
      holder.hidden = true;
      console.error(error);
    });
}
