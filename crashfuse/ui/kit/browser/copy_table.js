export default ({ parentElement, data }) => {
  const button = parentElement.querySelector("button");
  button.onclick = async () => {
    try {
      await navigator.clipboard.writeText(data);
    } catch {  // an address that is not secure, or a browser that refuses
      const area = Object.assign(document.createElement("textarea"), { value: data });
      document.body.append(area);
      area.select();
      document.execCommand("copy");
      area.remove();
    }
    button.textContent = "Copied";
    setTimeout(() => { button.textContent = "Copy"; }, 1500);
  };
};
