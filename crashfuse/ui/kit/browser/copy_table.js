export default ({ parentElement, data }) => {
  const button = parentElement.querySelector("button");
  let table = null;
  for (let node = parentElement.getRootNode().host ?? parentElement; node && !table; node = node.parentElement) {
    table = node.previousElementSibling?.querySelector("table");
  }
  data.meanings.forEach((meaning, row) => {
    const cell = table?.querySelector(`tbody tr:nth-child(${row + 1}) td`);
    if (cell) Object.assign(cell, { title: meaning }).style.cursor = "help";
  });
  button.onclick = async () => {
    try {
      await navigator.clipboard.writeText(data.text);
    } catch {  // an address that is not secure, or a browser that refuses
      const area = Object.assign(document.createElement("textarea"), { value: data.text });
      document.body.append(area);
      area.select();
      document.execCommand("copy");
      area.remove();
    }
    button.textContent = "Copied";
    setTimeout(() => { button.textContent = "Copy"; }, 1500);
  };
};
