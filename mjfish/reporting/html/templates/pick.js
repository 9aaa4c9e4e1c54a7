// Shows one of several trials: the one that is picked.
function pick(select) {
  [...document.getElementById(select.dataset.picks).children].forEach((choice, k) => {
    choice.hidden = k !== Number(select.value);
    drawIn(choice);
  });
}

document.querySelectorAll("select[data-picks]").forEach((select) => {
  select.addEventListener("change", () => pick(select));
  pick(select);
});
drawAll();
