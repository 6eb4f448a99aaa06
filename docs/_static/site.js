// What scrolls can be reached by the keyboard, and the headings of the sidebar have a level.
for (const region of document.querySelectorAll("pre, .table-wrapper")) {
  if (region.scrollWidth > region.clientWidth) region.tabIndex = 0;
}
for (const caption of document.querySelectorAll(".caption[role=heading]")) caption.ariaLevel = "2";
