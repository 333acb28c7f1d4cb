// The slider of a travel: one of its stops is shown at a time. Without a script all of them stand below each other.
(() => {
  const travel = document.querySelector(".travel");
  const slider = travel.querySelector("input");
  const stops = [...travel.querySelectorAll(".stop")];

  function show() {
    stops.forEach((stop, number) => { stop.hidden = number !== slider.valueAsNumber; });
    slider.setAttribute("aria-valuetext", stops[slider.valueAsNumber].querySelector("p").textContent);
  }

  slider.addEventListener("input", show);
  travel.classList.add("live");
  show();
})();
