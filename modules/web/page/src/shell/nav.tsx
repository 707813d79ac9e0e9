// The navigation: at the side of a wide screen, at the bottom of a phone, where the rest is under "More".
import { Ellipsis, ListOrdered } from "lucide-preact";
import { useEffect, useState } from "preact/hooks";
import { may, me } from "../state";
import { type View, view, views } from "../views";
import { t } from "../words";
import { recentShown, toggleRecent } from "./recent";

export function Nav() {
  const [open, setOpen] = useState(false);
  const all = views.value;
  // Few fit without "More".
  const few = all.length <= 4;
  const more = few ? [] : all.filter((each) => !each.first);
  const current = view.value;
  const count = more.reduce((sum, each) => sum + (each.count?.() ?? 0), 0);
  useEffect(() => setOpen(false), [current.id]);
  return (
    <nav class="nav" aria-label={t("Views")}>
      <p class="nav-name">
        {me.value?.robot ?? "advee"} <small>{me.value?.version}</small>
      </p>
      <ul>
        {all.map((each) => (
          <li key={each.id} class={each.first || few ? "first" : "later"}>
            <Item view={each} current={each.id === current.id} />
          </li>
        ))}
        {may("viewer") ? (
          <li class="later beside">
            <RecentItem />
          </li>
        ) : null}
        <li class="more" hidden={few}>
          <button type="button" class={`nav-item ${current.first ? "" : "is-current"}`} aria-expanded={open} aria-controls="nav-more" onClick={() => setOpen(!open)}>
            <Ellipsis size={22} aria-hidden />
            <span>{current.first ? t("More") : t(current.label)}</span>
            <Count of={count} />
          </button>
        </li>
      </ul>
      {open ? (
        <ul id="nav-more" class="nav-more" onKeyDown={(event) => event.key === "Escape" && setOpen(false)}>
          {more.map((each) => (
            <li key={each.id} onClick={() => setOpen(false)}>
              <Item view={each} current={each.id === current.id} />
            </li>
          ))}
          <li onClick={() => setOpen(false)}>
            <RecentItem />
          </li>
        </ul>
      ) : null}
    </nav>
  );
}

function Item({ view: { id, label, icon: Icon, count }, current }: { view: View; current: boolean }) {
  return (
    <a class={`nav-item ${current ? "is-current" : ""}`} href={`#/${id}`} aria-current={current ? "page" : undefined}>
      <Icon size={22} aria-hidden />
      <span>{t(label)}</span>
      <Count of={count?.() ?? 0} />
    </a>
  );
}

/** Shows the latest messages beside the view, whichever it is. */
function RecentItem() {
  return (
    <button type="button" class="nav-item" aria-pressed={recentShown.value} onClick={toggleRecent}>
      <ListOrdered size={22} aria-hidden />
      <span>{t("Recent")}</span>
    </button>
  );
}

function Count({ of }: { of: number }) {
  return of > 0 ? (
    <b class="nav-count">
      {of}
      <span class="visually-hidden"> {t("to look at")}</span>
    </b>
  ) : null;
}
