export default ({ parentElement, setTriggerValue }) => {
  const ground = () => getComputedStyle(parentElement.host ?? parentElement).getPropertyValue("--st-background-color");
  let shown = ground();
  const look = setInterval(() => {
    if (ground() === shown) return;
    shown = ground();
    setTriggerValue("ground", shown);
  }, 200);  // ms
  return () => clearInterval(look);
};
