// While a file is made Streamlit disables its button, which then loses the focus, and a dialog no longer hears Escape.
export default () => {
  const close = ({ key, target }) => {
    if (key === "Escape" && target === document.body) {
      document.querySelector('[data-testid="stDialog"] [aria-label="Close"]')?.click();
    }
  };
  document.addEventListener("keydown", close);
  return () => document.removeEventListener("keydown", close);
};
