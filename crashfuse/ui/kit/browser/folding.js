const narrow = matchMedia("(max-width: 1099px)"), phone = matchMedia("(max-width: 768px)");
const FOLDED = "crashfuse folded the sidebar";
const press = css => document.querySelector(css)?.click();
const follow = () => {
  if (narrow.matches) {
    press('[data-testid="stSidebarCollapseButton"] button');
    localStorage.setItem(FOLDED, "yes");
  } else if (localStorage.getItem(FOLDED)) {  // Streamlit remembers it folded; a reader's own folding stays
    press('[data-testid="stExpandSidebarButton"]');
    localStorage.removeItem(FOLDED);
  }
};
follow();
narrow.addEventListener("change", follow);
phone.addEventListener("change", () => setTimeout(() => narrow.matches && follow(), 300));  // Streamlit unfolds it
export default () => {};
