// The page in Czech: as the browser says, or as it was chosen on the device; at once, and kept.
import { equal, match, ok } from "node:assert/strict";
import { PROFILES } from "./support/browser";
import { scene } from "./support/scene";

for (const profile of PROFILES) {
  scene(`a Czech browser has a Czech page: status, Stop, driving, and why it does not move (${profile})`, async ({ robot, visit }) => {
    const v = await visit({ profile, as: "operator", locale: "cs-CZ" });
    const lang = () => v.page.evaluate(() => document.documentElement.lang);
    await v.shows("Připraven");
    equal(await lang(), "cs");
    match((await v.reason.textContent()) ?? "", /^robot stojí a\u00A0nemá žádný povel$/);
    match((await v.stop.textContent()) ?? "", /^Zastavit/);
    await v.go("Jízda");
    await v.button("Převzít řízení").first().waitFor();
    if (profile === "desktop") await v.pad.getByText("Řízení nemá nikdo. Nejprve je převezměte.").waitFor();
    ok((await v.page.locator(".gauge").first().textContent())?.includes("0,00\u00A0m/s"), "figures have a comma");

    await robot.fault("psc1", "bumper", 2);
    await v.shows("Pozastaven");
    match((await v.reason.textContent()) ?? "", /^je aktivní PAUSE: nárazník 2;/);
    await v.card(/^PAUSE: robot stojí, příčina: nárazník 2/).getByText("Odstraňte, čeho se dotýká nárazník 2.").waitFor();
    await robot.advee("fault", "psc1", "none");
    await robot.release();
    await v.shows("Připraven");

    await v.press(v.stop);
    await v.shows("Zastaven");
    await robot.goOn();
    await v.stop.waitFor();
  });
}

scene("the language is chosen on the device: at once, without a reload, and kept", async ({ visit }) => {
  const v = await visit({ as: "operator", locale: "cs-CZ" });
  const lang = () => v.page.evaluate(() => document.documentElement.lang);
  await v.shows("Připraven");
  await v.go("Toto zařízení");
  await v.press(v.button("English"));
  await v.shows("Ready");
  equal(await lang(), "en");
  match((await v.stop.textContent()) ?? "", /^Stop/);
  await v.go("Drive");
  await v.button("Take control").first().waitFor();
  await v.page.reload();
  await v.shows("Ready");
  await v.go("This device");
  await v.press(v.button("As the browser"));
  await v.shows("Připraven");
  equal(await lang(), "cs");
  equal(await v.page.title().then((title) => title.startsWith("Toto zařízení")), true);
});

scene("an English browser may have a Czech page, whose views for engineers stay English", async ({ visit }) => {
  const v = await visit({ as: "engineer" });
  await v.shows("Ready");
  await v.go("This device");
  await v.press(v.button("Čeština"));
  await v.shows("Připraven");
  await v.go("Zprávy");
  await v.page.locator('main [lang="en"]').getByRole("region").first().waitFor({ state: "attached" });
});
