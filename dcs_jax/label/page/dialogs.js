// The keys, and the formats to export to.

const FORMATS = {
  csv: "Table: a row per frame and object",
  otb: "OTB: x, y, w, h, a line per frame, a file per object",
  mot: "MOTChallenge: text with numbers of objects",
  cvat: "CVAT for video 1.1: XML with keyframes and outside",
  coco: "COCO: JSON with track ids",
  yolo: "YOLO: a folder of labels (zip)",
};

function closing(dialog) {
  const form = document.createElement("form");
  form.method = "dialog";
  const button = document.createElement("button");
  button.className = "wide";
  button.textContent = "Close";
  button.addEventListener("click", (event) => {
    event.preventDefault();
    dialog.close();
  });
  form.append(button);
  return form;
}

function open(dialog, title, ...content) {
  if (dialog.open) return;
  const heading = document.createElement("h3");
  heading.textContent = title;
  dialog.replaceChildren(heading, ...content, closing(dialog));
  dialog.onclick = (event) => event.target === dialog && dialog.close();
  dialog.showModal();
}

export function keysDialog(keys) {
  const table = document.createElement("div");
  table.className = "key-table";
  for (const [shown, , , text] of keys) {
    if (!shown) continue;
    const row = document.createElement("div");
    const [left, right] = [document.createElement("span"), document.createElement("span")];
    for (const key of shown.split(" ")) {
      const cap = document.createElement("kbd");
      cap.textContent = key;
      left.append(cap);
    }
    right.textContent = text;
    row.append(left, right);
    table.append(row);
  }
  open(document.querySelector("#keys"), "Keys", table);
}

export async function exportDialog(model) {
  const dialog = document.querySelector("#exports");
  const names = await (await fetch("/formats")).json();
  const buttons = names.map((name) => {
    const button = document.createElement("button");
    button.className = "format";
    button.dataset.format = name;
    const [strong, span] = [document.createElement("strong"), document.createElement("span")];
    strong.textContent = name;
    span.textContent = FORMATS[name] ?? "";
    button.append(strong, span);
    button.addEventListener("click", () => save(model, name, dialog));
    return button;
  });
  open(dialog, "Export the boxes", ...buttons);
}

async function save(model, format, dialog) {
  dialog.close();
  const response = await fetch(`/export/${format}`);
  if (!response.ok) {
    model.say(await response.text());
    return;
  }
  const link = document.createElement("a");
  link.href = URL.createObjectURL(await response.blob());
  const given = response.headers.get("Content-Disposition").split("''")[1];
  link.download = decodeURIComponent(given);
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  model.say(`Exported: ${link.download}`);
}
