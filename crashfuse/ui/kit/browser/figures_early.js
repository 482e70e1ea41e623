export default ({ data }) => {
  const streamlit = document.querySelector('script[src*="static/js/"]');
  const load = () => import(new URL(data, streamlit.src)).catch(() => {});
  if (data && streamlit) (window.requestIdleCallback ?? setTimeout)(load);
};
