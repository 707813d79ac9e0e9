// A table that sorts by its heads. On a narrow screen each row becomes a card, its cells named.
import { ArrowDown, ArrowUp } from "lucide-preact";
import type { ComponentChildren } from "preact";
import { useState } from "preact/hooks";
import { t } from "../words";

export interface Column<Row> {
  /** Its head, and the name of the cell on a narrow screen. */
  head: string;
  cell: (row: Row) => ComponentChildren;
  /** What it is sorted by; without it the column cannot be sorted. */
  by?: (row: Row) => number | string;
  /** Right aligned, figures of one width. */
  figure?: boolean;
  /** The row's name: a row header, and the title of its card. */
  title?: boolean;
}

type Order = { head: string; down: boolean };

export function Table<Row>(props: {
  /** Says what it shows; for screen readers only. */
  caption: string;
  columns: Column<Row>[];
  rows: Row[];
  id: (row: Row) => string | number;
  /** Sorted like this at first; without it rows stay as they come. */
  order?: Order;
  /** Shown greyed: the row's values are stale. */
  stale?: (row: Row) => boolean;
  empty?: string;
  /** Rows under headings: which a row belongs to, and the headings in their order. */
  groups?: { of: (row: Row) => string; heads: readonly string[] } | undefined;
}) {
  const { caption, columns, id } = props;
  const [order, setOrder] = useState<Order | null>(props.order ?? null);
  const by = columns.find((column) => column.head === order?.head)?.by;
  const rows = by && order ? sorted(props.rows, by, order.down) : props.rows;
  const turn = (head: string) => setOrder((old) => ({ head, down: old?.head === head ? !old.down : false }));
  if (rows.length === 0) return <p class="empty">{props.empty ?? t("There is none.")}</p>;
  const { groups } = props;
  const parts = groups ? groups.heads.map((head) => ({ head, rows: rows.filter((row) => groups.of(row) === head) })) : [{ head: "", rows }];
  return (
    <div class="table-scroll">
      <table>
        <caption class="visually-hidden">{caption}</caption>
        <thead>
          <tr>
            {columns.map((column) => {
              const sort = order?.head === column.head ? (order.down ? "descending" : "ascending") : undefined;
              return (
                <th key={column.head} scope="col" class={column.figure ? "figure" : ""} aria-sort={column.by ? (sort ?? "none") : undefined}>
                  {column.by ? (
                    <button type="button" onClick={() => turn(column.head)}>
                      {column.head}
                      {sort === "descending" ? <ArrowDown size={14} aria-hidden /> : null}
                      {sort === "ascending" ? <ArrowUp size={14} aria-hidden /> : null}
                    </button>
                  ) : (
                    column.head
                  )}
                </th>
              );
            })}
          </tr>
        </thead>
        {parts.map((part) =>
          part.rows.length === 0 ? null : (
            <tbody key={part.head}>
              {part.head ? (
                <tr class="table-group">
                  <th scope="rowgroup" colSpan={columns.length}>
                    {part.head}
                  </th>
                </tr>
              ) : null}
              {part.rows.map((row) => (
                <tr key={id(row)} class={props.stale?.(row) ? "is-stale" : ""}>
                  {columns.map((column) => {
                    const kind = `${column.figure ? "figure" : ""} ${column.title ? "title" : ""}`;
                    return column.title ? (
                      <th key={column.head} scope="row" class={kind} data-head={column.head}>
                        {column.cell(row)}
                      </th>
                    ) : (
                      <td key={column.head} class={kind} data-head={column.head}>
                        <div>{column.cell(row)}</div>
                      </td>
                    );
                  })}
                </tr>
              ))}
            </tbody>
          ),
        )}
      </table>
    </div>
  );
}

function sorted<Row>(rows: Row[], by: (row: Row) => number | string, down: boolean): Row[] {
  const sign = down ? -1 : 1;
  return [...rows].sort((a, b) => {
    const [x, y] = [by(a), by(b)];
    return sign * (x < y ? -1 : x > y ? 1 : 0);
  });
}
