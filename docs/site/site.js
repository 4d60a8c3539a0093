// SPDX-License-Identifier: Apache-2.0
// Tables that are wider than the page scroll; the keyboard reaches them, too, which the theme leaves out.
const reach_tables = () => {
  for (const scroller of document.querySelectorAll(".md-typeset__scrollwrap"))
    if (scroller.scrollWidth > scroller.clientWidth) scroller.tabIndex = 0;
    else scroller.removeAttribute("tabindex");
};
addEventListener("load", reach_tables);
addEventListener("resize", reach_tables);
