export default ({ setTriggerValue }) => {
  const open = event => {
    const rating = event.target.closest?.(".cf-ratings [data-approach]");
    if (rating) setTriggerValue("approach", rating.dataset.approach);
    return rating;
  };
  const press = event => {
    if (["Enter", " "].includes(event.key) && open(event)) event.preventDefault();  // Space would scroll
  };
  document.addEventListener("click", open);
  document.addEventListener("keydown", press);
  return () => {
    document.removeEventListener("click", open);
    document.removeEventListener("keydown", press);
  };
};
